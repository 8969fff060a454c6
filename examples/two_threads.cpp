// Real time: a simulator on one thread, the haptic loop at 1 kHz on another, the newest model between them without a
// lock. The simulator is a wall of jelly at z = 0. Needs palpate::haptics alone.
#include <palpate/haptics.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

int main() {
  const palpate::Pose start{{0, 0, 0.01}, {1, 0, 0, 0}};
  const auto device = palpate::simulatedDevice({{{0.05}, {0.3, {0, 0, -0.02}}}, true}, start);
  palpate::HapticSettings settings;
  settings.link = palpate::Link::of(device->limits());
  settings.safety = palpate::Safety::of(device->limits());
  settings.proxy.gravity = {0, 0, 0};
  palpate::HapticLoop loop(settings);
  device->begin(start, loop.start(start, start, 0));

  palpate::ModelExchange models;
  std::atomic<double> height{start.position[2]};  // of the proxy, from the loop to the simulator
  std::atomic<double> now{0};
  std::atomic<bool> stop{false};
  std::thread simulator([&] {
    while (!stop) {
      palpate::HandleModel model;
      model.time = now;
      model.pose.position[2] = height;
      if (height < 0) {
        model.force[2] = -300 * height;
        model.kx[2 * 6 + 2] = -300;  // N/m
        model.kv[2 * 6 + 2] = -1;    // N s/m
      }
      models.publish(model);
      std::this_thread::sleep_for(std::chrono::milliseconds(30));
    }
  });

  double peak = 0;
  const palpate::LoopReport report =
      palpate::runHapticLoop(loop, *device, models, 0.5, stop, [&](const palpate::Tick& t) {
        height = t.proxy.position[2];
        now = t.time;
        peak = std::max(peak, t.sent[2]);
      });
  stop = true;
  simulator.join();
  std::printf("%llu ticks, %llu missed; half of them took less than %.1f us; at most %.2f N\n",
              static_cast<unsigned long long>(report.ticks), static_cast<unsigned long long>(report.missed),
              report.work_us[0], peak);
  if (!report.note.empty()) std::printf("%s\n", report.note.c_str());
  return peak > 0.5 ? 0 : 1;
}
