// Save a world, try two futures from the same moment, and come back to it to the bit; the same for a whole run.
#include <palpate/palpate.h>

#include <cstdio>
#include <string>

constexpr const char* kScene = R"(
palpate: 1
name: cube
duration: 0.6
tool:
  shape: {bar: {size: [0.06, 0.06, 0.06], cells: [3, 3, 3]}}
  pose: {position: [0, 0, 0.002]}
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.0599], normal: [0, 0, 1]}}
      hand: {keyframes: [{t: 0}, {t: 0.5, position: [0.01, 0, -0.01]}]}
obstacles: [{name: ground, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}]
)";

int main() {
  const palpate::Scene scene = palpate::Scene::parse(kScene);

  palpate::World world(scene);
  palpate::DeviceState device{world.start()};
  device.pose.position[2] -= 0.008;
  for (int i = 0; i < 5; ++i) world.step(device);
  const std::string moment = world.save();

  const auto forceAfterTilt = [&](double radians) {
    world.restore(moment);
    palpate::DeviceState tilted = device;
    tilted.pose = palpate::moved(device.pose, {0, 0, 0, radians, 0, 0});
    for (int i = 0; i < 5; ++i) world.step(tilted);
    return world.couplingWrench()[2];
  };
  const double straight = forceAfterTilt(0), tilted = forceAfterTilt(0.1), again = forceAfterTilt(0);
  std::printf("force on the handle: %.6f N; tilted %.6f N; straight again %.6f N\n", straight, tilted, again);

  double sent = 0;
  palpate::RunOptions options;
  options.tick = [&](const palpate::Tick& t) { sent = t.sent[2]; };
  palpate::Run run(scene, options);
  run.advance(400);
  const palpate::RunState state = run.save();
  run.finish();
  const double first = sent;
  run.restore(state);
  run.finish();
  std::printf("last force of the run: %.6f N; from the saved tick on %.6f N\n", first, sent);
  return straight == again && straight != tilted && first == sent ? 0 : 1;
}
