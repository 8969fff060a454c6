// No tunneling: tools swung into thin plates and bodies thrown at each other stay on their sides, whatever the step.
#include <gtest/gtest.h>

#include <random>

#include "palpate/mesh/embedding_map.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kThickness = 0.001;  // of the plate [m]

Obstacle plate() { return {BoxShape{Pose{}, Vec3(1.0, 1.0, 0.5 * kThickness)}, 0.3, "plate"}; }

double lowest(const Body& body) {
  const VecX points =
      EmbeddingMap(body.model.mesh().mesh, body.model.mesh().embedding).interpolate(body.state.positions);
  double z = points[2];
  for (Eigen::Index i = 2; i < points.size(); i += 3) z = std::min(z, points[i]);
  return z;
}

// The device swings through the plate at 2 m/s, turning, from a random attitude, for 0.2 s, and stays below it for as
// long. The tool stays above; and as the link pulls it down all the time, it ends pressed on the plate: motions that
// were cut short again and again would leave it hanging in the air.
void swing(int seed) {
  constexpr double h = 0.033;
  constexpr int kMoving = 6, kSteps = 12;
  std::mt19937 random(static_cast<unsigned>(seed));
  std::uniform_real_distribution<double> uniform(-1, 1);
  const Vec3 axis = Vec3(uniform(random), uniform(random), uniform(random)).normalized();
  World world;
  world.link = {700, 2, 1.0, 0.01};
  world.obstacles = {plate()};
  Pose attitude{Vec3::Zero(), expRotation(3 * uniform(random) * axis)};
  const Vec3 size(0.05, 0.03, 0.02);
  double bottom = 0;
  for (int corner = 0; corner < 8; ++corner) {
    bottom = std::min(bottom, attitude.apply(size.cwiseProduct(Vec3(corner & 1, corner >> 1 & 1, corner >> 2))).z());
  }
  attitude.position.z() = 0.01 + 0.02 * (1 + uniform(random)) - bottom;
  const SimulationMesh bar = barMesh(size, {2, 2, 2});
  BodyModel body("bar", moved(bar, attitude), {});
  HandleOptions handle = kPlainHandle;
  handle.inertia.setConstant(1e-5);
  holdNodes(body, nodesWhere(bar.mesh.nodes, [](const Vec3& p) { return p.z() < 1e-9; }), handle);  // one end
  world.add(std::move(body), true);
  ASSERT_GT(lowest(world.tool()), 0.5 * kThickness);
  DeviceTarget device{world.tool().state.handle.pose, Vec6::Zero()};
  const Vec3 down = Vec3(0.7 * uniform(random), 0.7 * uniform(random), -1).normalized();
  device.twist << 2.0 * down, 20.0 * Vec3(uniform(random), uniform(random), uniform(random)).normalized();
  int active = 0;
  for (int n = 0; n < kSteps; ++n) {
    if (n == kMoving) device.twist.setZero();
    device.pose = advance(device.pose, h * device.twist);
    const StepReport report = world.step(device, h);
    ASSERT_NE(report.status, StepStatus::restored) << "seed " << seed;
    ASSERT_GT(lowest(world.tool()), 0.5 * kThickness) << "seed " << seed << " step " << n;
    active = report.active;
  }
  EXPECT_GT(active, 0) << "seed " << seed;
}

TEST(ThinPlate, KeepsAToolThatIsSwungThroughItOnItsSide) {
  for (int seed = 0; seed < 400; ++seed) swing(seed);
}

}  // namespace
}  // namespace palpate
