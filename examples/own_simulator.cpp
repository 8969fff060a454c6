// My own simulator behind Palpate's haptic loop. It steps 30 times a second and tells with each step the force on its
// handle and how that changes with the handle's pose and twist; the loop makes of it a force at 1 kHz. Needs
// palpate::haptics alone.
//
// The simulator here: a ball at the end of a spring, held 5 cm above a floor that pushes back with 800 N/m.
#include <palpate/haptics.h>

#include <cstdio>

namespace {

class BallSimulator {
 public:
  explicit BallSimulator(double z) : handle_(z), ball_(z - kRest) {}

  /// One step towards where the device is now: the ball moves to where spring and floor agree.
  palpate::HandleModel step(const palpate::DeviceState& device, double time) {
    handle_ = device.pose.position[2];
    const double free = handle_ - kRest;
    const bool touches = free < 0;
    ball_ = touches ? kSpring * free / (kSpring + kFloor) : free;
    palpate::HandleModel model;
    model.time = time;
    model.pose.position = model.handle_pose.position = {0, 0, handle_};
    model.force[2] = -kSpring * (handle_ - ball_ - kRest);  // on the handle
    if (touches) model.kx[2 * 6 + 2] = -kSpring * kFloor / (kSpring + kFloor);
    return model;
  }

 private:
  static constexpr double kRest = 0.05, kSpring = 400, kFloor = 800;  // m, N/m
  double handle_, ball_;
};

}  // namespace

int main() {
  const palpate::Pose start{{0, 0, 0.06}, {1, 0, 0, 0}};
  const auto device = palpate::simulatedDevice({{{0.1}, {0.6, {0, 0, -0.02}}, {0.8, {0, 0, -0.02}}}, true}, start);

  palpate::HapticSettings settings;
  settings.link = palpate::Link::of(device->limits());
  settings.safety = palpate::Safety::of(device->limits());
  settings.proxy.gravity = {0, 0, 0};
  palpate::HapticLoop loop(settings);
  device->begin(start, loop.start(start, start, 0));

  BallSimulator simulator(start.position[2]);
  palpate::HandleModel model, next;
  double force = 0;
  for (int k = 0; k < 1000; ++k) {
    const double t = k * settings.step;
    const palpate::DeviceState state = device->sample(t);
    if (k % 33 == 0) {  // the step that began 33 ms ago is done
      model = next;
      next = simulator.step(state, t);
    }
    const palpate::Tick tick = loop.tick(state, k < 33 ? nullptr : &model, t);
    device->apply(tick.sent, t, settings.step);
    force = tick.sent[2];
    if (k % 100 == 99) std::printf("%.1f s: device at %5.1f mm, %5.2f N\n", t, 1e3 * state.pose.position[2], force);
  }
  return force > 1.0 && force < 3.3 ? 0 : 1;  // pressed, and within what the device can
}
