// The linearization against central differences of an independent slow step (check.h), in every regime of contact.
#include "palpate/linearization/linearize.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "palpate/math/rotation.h"
#include "palpate/study/check.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

int flatOnesAtTheHandle(const Body& tool) {
  const std::vector<int>& boundary = tool.model.boundaryElements();
  const std::vector<FlatElement>& flat = tool.state.elastic.flat;
  return static_cast<int>(
      std::count_if(boundary.begin(), boundary.end(), [&](int e) { return flatElement(flat, e) != nullptr; }));
}

// Soft 6 cm cube of 162 tetrahedra held at its top layer, bottom at z = 0.
World heldCube(double friction, FrictionCone cone = {}) {
  Material material;
  material.damping_alpha = 0.3;  // exercised, though off by default
  BodyModel body("cube", barMesh({0.06, 0.06, 0.06}, {3, 3, 3}), material);
  holdNodes(body, [](const Vec3& p) { return p.z() > 0.06 - 1e-9; });
  World world;
  world.link = {700, 2, 1.0, 0.01};
  world.contact.cone = cone;
  world.obstacles.push_back({PlaneShape{}, friction, "ground"});
  world.add(std::move(body));
  return world;
}

struct Regime {
  const char* name;
  double friction;
  bool exact;
  Vec6 motion;  // offset of the device after the approach [m, rad]
  Vec6 speed;   // device twist while it moves there
  int steps;
  int least_sticking, least_sliding;
};

class Linearization : public ::testing::TestWithParam<Regime> {};

TEST_P(Linearization, AgreesWithCentralDifferences) {
  const Regime& regime = GetParam();
  FrictionCone cone;
  cone.exact = regime.exact;
  World world = heldCube(regime.friction, cone);
  const Pose start = world.tool().state.handle.pose;
  const double h = 0.01;
  DeviceTarget target{start, regime.speed};
  for (int i = 1; i <= regime.steps; ++i) {
    target.pose = advance(start, regime.motion * (static_cast<double>(i) / regime.steps));
    ASSERT_NE(world.step(target, h).status, StepStatus::restored);
  }
  for (const Derivative derivative : {Derivative::frozen, Derivative::full}) {
    const LinearizationCheck check = checkLinearization(world, target, h, {DelassusModel::exact, derivative});
    EXPECT_LT(check.force_error, 1e-9);
    EXPECT_GE(check.sticking, regime.least_sticking);
    EXPECT_GE(check.sliding, regime.least_sliding);
    EXPECT_EQ(flatOnesAtTheHandle(world.tool()) > 0, std::string(regime.name) == "pressed_flat");
    if (derivative == Derivative::frozen) {
      EXPECT_LT(check.kx_frozen.worst(), 1e-6);
      EXPECT_LT(check.kv_frozen.worst(), 1e-6);
    } else {
      EXPECT_LT(check.kx_full.worst(), 1e-5);
      EXPECT_LT(check.kv_full.worst(), 1e-5);
    }
    // the two derivatives differ: neither check can pass for the wrong one
    EXPECT_GT(derivative == Derivative::frozen ? check.kx_full.worst() : check.kx_frozen.worst(), 1e-4);
  }
}

Vec6 vec6(double a, double b, double c, double d, double e, double f) {
  Vec6 v;
  v << a, b, c, d, e, f;
  return v;
}

INSTANTIATE_TEST_SUITE_P(
    Regimes, Linearization,
    ::testing::Values(
        Regime{"free", 0.5, false, vec6(0.01, 0, 0.05, 0.3, 0.1, 0), vec6(0.1, 0, 0.2, 1, 0, 0), 10, 0, 0},
        Regime{"fast_turn", 0.5, false, vec6(0, 0, 0.08, 0.9, 0.6, -0.5), vec6(0, 0, 0, 8, 2, -3), 12, 0, 0},
        Regime{"sticking", 5.0, false, vec6(0.001, 0, -0.01, 0.05, 0.02, 0.01), vec6(0, 0, -0.1, 0, 0, 0), 10, 8, 0},
        Regime{"sliding_polyhedral", 0.3, false, vec6(0.02, 0.009, -0.01, 0, 0, 0.1), vec6(0.3, 0.1, 0, 0, 0, 0), 10, 0,
               4},
        Regime{"sliding_exact", 0.3, true, vec6(0.02, 0.009, -0.01, 0, 0, 0.1), vec6(0.3, 0.1, 0, 0, 0, 0), 10, 0, 4},
        Regime{"frictionless", 0.0, false, vec6(0.01, 0, -0.01, 0.2, 0, 0), vec6(0.1, 0, 0, 0, 0, 0), 10, 0, 4},
        Regime{"pressed_flat", 0.5, false, vec6(0.002, 0, -0.16, 0.1, 0.05, 0), vec6(0, 0, -0.1, 0, 0, 0), 40, 4, 0},
        Regime{"on_the_handle", 0.4, false, vec6(0, 0, -0.035, 2.2, 0, 0), vec6(0, 0.2, 0, 1, 0, 0), 40, 0, 1}),
    [](const auto& regime) { return std::string(regime.param.name); });

}  // namespace
}  // namespace palpate
