// What a handle model is: the derivative of one step. Checked against two steps from the same state, with the handle a
// little to either side; saved and restored in between.
#include <palpate/palpate.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

constexpr const char* kScene = R"(
palpate: 1
name: cube
tool:
  shape: {bar: {size: [0.06, 0.06, 0.06], cells: [3, 3, 3]}}
  handles: {top: {region: {halfspace: {point: [0, 0, 0.0599], normal: [0, 0, 1]}}}}
)";

int main() {
  palpate::Scene scene = palpate::Scene::parse(kScene);
  palpate::World world(scene);
  palpate::DeviceState device{world.start()};
  device.pose = palpate::moved(device.pose, {0.01, 0, 0.005, 0, 0.1, 0});  // bent and in motion
  for (int i = 0; i < 3; ++i) world.step(device);
  const std::string moment = world.save();
  const palpate::Pose handle = world.handle();
  const palpate::Vector6 twist = world.handleTwist();
  world.step(device);
  const palpate::HandleModel model = world.linearize({.exact = true, .full = true});

  double worst = 0, largest = 0;
  for (int column = 0; column < 6; ++column) {
    palpate::Vector6 wrench[2];
    const double by = column < 3 ? 1e-6 : 1e-5;  // m, rad
    for (int side = 0; side < 2; ++side) {
      palpate::Vector6 change{};
      change[column] = side == 0 ? by : -by;
      world.restore(moment);
      world.setHandle(palpate::moved(handle, change), twist);
      world.step(device);
      wrench[side] = world.couplingWrench();
    }
    for (int row = 0; row < 6; ++row) {
      const double scale = (row < 3 ? 1 : 1 / 0.05) * (column < 3 ? 1 : 1 / 0.05);  // rotations as of 5 cm away
      const double difference = (wrench[0][row] - wrench[1][row]) / (2 * by), exact = model.kx[6 * row + column];
      worst = std::max(worst, scale * std::abs(difference - exact));
      largest = std::max(largest, scale * std::abs(exact));
    }
  }
  std::printf("kx: largest entry %.1f N/m, largest error %.2g of it\n", largest, worst / largest);
  return worst < 1e-4 * largest ? 0 : 1;
}
