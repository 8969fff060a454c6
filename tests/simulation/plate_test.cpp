// No tunneling: tools swung into thin plates and bodies thrown at each other stay on their sides, whatever the step.
#include <gtest/gtest.h>

#include <random>

#include "palpate/mesh/embedding_map.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

constexpr double kThickness = 0.001;  // of the plate [m]

Obstacle plate() { return {BoxShape{Pose{}, Vec3(1.0, 1.0, 0.5 * kThickness)}, 0.3, "plate"}; }

double lowest(const Body& body) {
  const VecX points = EmbeddingMap(body.mesh().mesh, body.mesh().embedding).interpolate(body.positions());
  double z = points[2];
  for (Eigen::Index i = 2; i < points.size(); i += 3) z = std::min(z, points[i]);
  return z;
}

// The device swings through the plate at 2 m/s and 20 rad/s, from a random attitude, and stays below it.
TEST(Tunneling, AToolSwungIntoAThinPlateStaysOnItsSide) {
  int cut = 0;
  double gap = 1e300;
  for (int seed = 0; seed < 1000; ++seed) {
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
    Body body("bar", test::moved(barMesh(size, {2, 2, 2}), attitude), {});
    std::vector<int> nodes;
    std::vector<Vec3> positions;
    std::vector<double> masses;
    for (int i = 0; i < 9; ++i) {  // one end layer
      nodes.push_back(i);
      positions.push_back(body.mesh().mesh.nodes[i]);
      masses.push_back(body.elasticity().mass()[i]);
    }
    body.hold(makeHandle("end", nodes, positions, masses, 0.02, Vec3(1e-5, 1e-5, 1e-5), Quat::Identity()));
    world.add(std::move(body), true);
    ASSERT_GT(lowest(world.tool()), 0.5 * kThickness);
    DeviceTarget device{world.tool().handle().pose, Vec6::Zero()};
    const Vec3 down = Vec3(0.7 * uniform(random), 0.7 * uniform(random), -1).normalized();
    device.twist << 2.0 * down, 20.0 * Vec3(uniform(random), uniform(random), uniform(random)).normalized();
    for (int n = 0; n < 12; ++n) {
      if (n == 6) device.twist.setZero();
      device.pose = advance(device.pose, 0.033 * device.twist);
      const StepReport report = world.step(device, 0.033);
      ASSERT_NE(report.status, StepStatus::restored) << "seed " << seed;
      cut += report.motion_share < 1 ? 1 : 0;
      ASSERT_GT(lowest(world.tool()), 0.5 * kThickness) << "seed " << seed << " step " << n;
      gap = std::min(gap, lowest(world.tool()) - 0.5 * kThickness);
    }
  }
  RecordProperty("least_gap_um", static_cast<int>(1e6 * gap));
  RecordProperty("motions_cut", cut);
  EXPECT_LT(cut, 1800);  // of 12,000; a cut motion is lost time
}

}  // namespace
}  // namespace palpate
