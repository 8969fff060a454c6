#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "palpate/common/error.h"
#include "shared/held_scenes.h"

// Static starts of what hangs, bends and lies: each has an equilibrium, and it is found.

namespace palpate::test {
namespace {

constexpr double kGravity = 9.81, kDensity = 1000;

Material materialOf(double youngs_modulus, double poisson_ratio) {
  Material m;
  m.youngs_modulus = youngs_modulus;
  m.poisson_ratio = poisson_ratio;
  m.density = kDensity;
  return m;
}

// Of the nodes on the lower end, below where they were, against the handle's displacement [m].
double elongation(const World& world, double length) {
  const BodyModel& model = world.tool().model;
  const VecX& x = world.tool().state.positions;
  double sum = 0, top = 0;
  int count = 0, tops = 0;
  for (int n = 0; n < model.nodes(); ++n) {
    const double z = model.mesh().mesh.nodes[n].z();
    if (z < 1e-9) {
      sum -= x[3 * n + 2];
      ++count;
    } else if (z > length * (1 - 1e-9)) {
      top += length - x[3 * n + 2];
      ++tops;
    }
  }
  return sum / count - top / tops;
}

class HangingBar : public testing::TestWithParam<double> {};

// rho g L / E from next to nothing to where it is half as long again. Without lateral contraction the stress at a
// height is the weight below it, and the elongation rho g L^2 / 2E, linear as the material is.
TEST_P(HangingBar, StretchesByItsWeight) {
  const double ratio = GetParam(), length = 0.16;
  const double youngs_modulus = kDensity * kGravity * length / ratio;
  World world = hangingBar(Vec3(0.04, 0.04, length), {3, 3, 12}, materialOf(youngs_modulus, 0.0));
  world.settle({0}, world.tool().state.handle.pose);
  const double expected = kDensity * kGravity * length * length / (2 * youngs_modulus);
  EXPECT_NEAR(elongation(world, length) / expected, 1, 1e-3);
}

TEST_P(HangingBar, ComesToRestThoughItContracts) {
  const double ratio = GetParam(), length = 0.16;
  World world = hangingBar(Vec3(0.04, 0.04, length), {3, 3, 12}, materialOf(kDensity * kGravity * length / ratio, 0.4));
  const Pose device = world.tool().state.handle.pose;
  world.settle({0}, device);
  const VecX before = world.tool().state.positions;
  const StepReport report = world.step({device, Vec6::Zero()}, 0.033);
  EXPECT_EQ(report.status, StepStatus::ok);
  EXPECT_LT((world.tool().state.positions - before).cwiseAbs().maxCoeff(), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(WeightByStiffness, HangingBar, testing::Values(1e-6, 1e-3, 0.05, 0.2, 0.4, 0.6));

TEST(Settle, RopeAndSheetHang) {
  struct Case {
    Vec3 size;
    std::array<int, 3> cells;
    double youngs_modulus;
  };
  for (const Case& c :
       {Case{Vec3(0.006, 0.006, 0.5), {1, 1, 40}, 2e4}, Case{Vec3(0.3, 0.004, 0.3), {12, 1, 12}, 1e4}}) {
    World world = hangingBar(c.size, c.cells, materialOf(c.youngs_modulus, 0.3));
    EXPECT_NO_THROW(world.settle({0}, world.tool().state.handle.pose)) << c.size.transpose();
  }
}

// Clamped level, it ends up hanging down: the way there is long and round.
TEST(Settle, ASheetHeldLevelByOneEdgeHangsDown) {
  World world;
  world.gravity = Vec3(0, 0, -kGravity);
  world.link.stiffness = 1e5;
  world.link.rotational_stiffness = 1e3;
  BodyModel body("sheet", barMesh(Vec3(0.2, 0.1, 0.002), {20, 6, 1}), materialOf(2e4, 0.3));
  holdNodes(
      body, [](const Vec3& x) { return x.x() < 1e-9; }, kPlainHandle);
  world.add(std::move(body));
  world.settle({0}, world.tool().state.handle.pose);
  double lowest = 0;
  const VecX& x = world.tool().state.positions;
  for (Eigen::Index n = 0; n < x.size() / 3; ++n) lowest = std::min(lowest, x[3 * n + 2]);
  EXPECT_LT(lowest, -0.15);
}

// Nothing is under it: the message says so.
TEST(Settle, SaysWhichMotionIsFree) {
  World world;
  world.gravity = Vec3(0, 0, -kGravity);
  world.add(BodyModel("thing", barMesh(Vec3(0.1, 0.1, 0.1), {2, 2, 2}), materialOf(1e4, 0.3)));
  try {
    world.settle({0}, Pose{});
    FAIL() << "settled in free fall";
  } catch (const RunError& e) {
    EXPECT_NE(std::string(e.what()).find("thing"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("moves freely along (0, 0, -1)"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("1 kg"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace palpate::test
