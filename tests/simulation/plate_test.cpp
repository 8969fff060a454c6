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

struct Swing {
  int cut = 0;         // motions cut short
  double gap = 1e300;  // least [m]
  double end_gap = 0;  // [m]
  int end_active = 0;
  double lost = 0;
  int passes = 0;
};

// The device swings through the plate at 2 m/s, from a random attitude, for 0.2 s, and stays below it for as long.
Swing swing(int seed, double spin) {
  constexpr double h = 0.033;
  Swing out;
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
  EXPECT_GT(lowest(world.tool()), 0.5 * kThickness);
  DeviceTarget device{world.tool().state.handle.pose, Vec6::Zero()};
  const Vec3 down = Vec3(0.7 * uniform(random), 0.7 * uniform(random), -1).normalized();
  device.twist << 2.0 * down, spin * Vec3(uniform(random), uniform(random), uniform(random)).normalized();
  for (int n = 0; n < 12; ++n) {
    if (n == 6) device.twist.setZero();
    device.pose = advance(device.pose, h * device.twist);
    const StepReport report = world.step(device, h);
    EXPECT_NE(report.status, StepStatus::restored) << "seed " << seed;
    out.cut += report.motion_share < 1 ? 1 : 0;
    out.lost += 1 - report.motion_share;
    if (report.motion_share < 1 && report.active == 0) printf("cut without contact\n");
    if (report.motion_share < 1) out.passes = std::max(out.passes, report.passes);
    out.end_gap = lowest(world.tool()) - 0.5 * kThickness;
    EXPECT_GT(out.end_gap, 0) << "seed " << seed << " step " << n;
    out.gap = std::min(out.gap, out.end_gap);
    out.end_active = report.active;
  }
  return out;
}
TEST(Experiment, Plate) {
  for (const double spin : {0.0, 5.0, 20.0}) {
    int cut = 0, most = 0, idle = 0;
    double lost = 0, worst = 0, end = 0, gap = 1;
    for (int seed = 0; seed < 1000; ++seed) {
      const Swing s = swing(seed, spin);
      cut += s.cut;
      most = std::max(most, s.cut);
      lost += s.lost;
      worst = std::max(worst, s.lost);
      end = std::max(end, s.end_gap);
      gap = std::min(gap, s.gap);
      idle += s.end_active == 0;
    }
    printf("spin %g cut %d most %d lost %g worst %g end gap %g least %g idle %d\n", spin, cut, most, lost, worst, end,
           gap, idle);
  }
}

}  // namespace
}  // namespace palpate
