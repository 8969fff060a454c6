// My own device: derive from palpate::Device. sample() says where it is, apply() takes the force. This one has no
// motors to speak of: a finger of 30 g on a soft spring, which is dragged sideways and gives way to the force.
#include <palpate/palpate.h>

#include <cstdio>
#include <memory>

namespace {

class Finger final : public palpate::Device {
 public:
  const char* name() const noexcept override { return "finger"; }
  palpate::DeviceLimits limits() const noexcept override {
    palpate::DeviceLimits limits;
    limits.peak_force = 2;  // N
    return limits;
  }
  void begin(const palpate::Pose& start, const palpate::Vector6& wrench) noexcept override {
    start_ = state_.pose = start;
    for (int i = 0; i < 3; ++i) load_[i] = wrench[i];  // what the finger carries from the start
  }
  palpate::DeviceState sample(double) noexcept override { return state_; }
  // Neither blocks, allocates nor throws.
  void apply(const palpate::Vector6& wrench, double t, double dt) noexcept override {
    const double target[3] = {t < 0.5 ? 0.04 * t : 0.02, 0, t < 0.3 ? -0.05 * t : -0.015};  // m, from the start
    for (int i = 0; i < 3; ++i) {
      double& x = state_.pose.position[i];
      double& v = state_.twist[i];
      const double pull = kSpring * (start_.position[i] + target[i] - x) - kDamping * v + wrench[i] - load_[i];
      v += dt / kMass * pull;
      x += dt * v;
    }
  }

 private:
  static constexpr double kMass = 0.03, kSpring = 300, kDamping = 4;  // kg, N/m, N s/m
  palpate::Pose start_;
  palpate::Vector3 load_{};
  palpate::DeviceState state_;
};

constexpr const char* kScene = R"(
palpate: 1
name: ball
duration: 0.8
tool:
  shape: {sphere: {radius: 0.03}}
  tetrahedra: 100
  pose: {position: [0, 0, 0.005]}
  handles: {top: {region: {halfspace: {point: [0, 0, 0.045], normal: [0, 0, 1]}}}}
obstacles: [{name: table, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}]
)";

}  // namespace

int main() {
  palpate::RunOptions options;
  options.device = std::make_shared<Finger>();
  options.tick = [](const palpate::Tick& t) {
    if (static_cast<int>(1000 * t.time + 0.5) % 100 == 0) {
      std::printf("%.1f s: finger at %5.1f, %5.1f mm; force on it %5.2f N aside, %5.2f N up\n", t.time,
                  1e3 * t.device.pose.position[0], 1e3 * t.device.pose.position[2], t.sent[0], t.sent[2]);
    }
  };
  const palpate::RunSummary summary = palpate::Run(palpate::Scene::parse(kScene), options).finish();
  return summary.ticks == 800 ? 0 : 1;
}
