// Coulomb friction in closed form: a soft block on an incline, made by tilting gravity.
#include <gtest/gtest.h>

#include <cmath>

#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kFriction = 0.5;
constexpr double kStep = 0.01;

enum class Tilt { gravity, plane };

// Block on an incline of slope tan(theta) whose fall line has the given azimuth from world x, at rest and settled
// level.
World inclined(double slope, double azimuth, const FrictionCone& cone, Tilt tilt = Tilt::gravity) {
  Material material;
  material.youngs_modulus = 1e5;
  material.damping_beta = 0.01;
  World world;
  world.contact.cone = cone;
  const double theta = std::atan(slope);
  const Vec3 fall(std::cos(azimuth), std::sin(azimuth), 0);
  if (tilt == Tilt::gravity) {
    world.obstacles = {ground(kFriction)};
    world.add(BodyModel("block", barMesh(kBarSize, {3, 3, 2}), material));
    world.gravity = 9.81 * (std::sin(theta) * fall - std::cos(theta) * Vec3::UnitZ());
  } else {
    const Pose turn{Vec3::Zero(), Quat(Eigen::AngleAxisd(theta, Vec3::UnitZ().cross(fall)))};
    world.obstacles = {{PlaneShape{Vec3::Zero(), turn.rotation * Vec3::UnitZ()}, kFriction, "incline"}};
    world.add(BodyModel("block", moved(barMesh(kBarSize, {3, 3, 2}), turn), material));
  }
  return world;
}

// Downhill speed of the center after the given time.
double speedAfter(World& world, double seconds) {
  for (int n = 0; n < static_cast<int>(std::lround(seconds / kStep)); ++n) {
    EXPECT_EQ(world.step({}, kStep).status, StepStatus::ok);
  }
  return centerVelocity(world.body(0)).norm();
}

struct Incline {
  const char* name;
  FrictionCone cone;
  double azimuth;    // of the fall line from world x
  double effective;  // friction along it, of kFriction
  Tilt tilt;
};

class OnIncline : public ::testing::TestWithParam<Incline> {};

TEST_P(OnIncline, SticksAndSlipsAtTheFrictionAngleWithinOnePercent) {
  const Incline& p = GetParam();
  const double critical = p.effective * kFriction;
  World below = inclined(0.99 * critical, p.azimuth, p.cone, p.tilt);
  speedAfter(below, 0.6);
  const Vec3 rest = center(below.body(0));
  EXPECT_LT(speedAfter(below, 0.4), 1e-6);
  EXPECT_LT((center(below.body(0)) - rest).norm(), 1e-6);
  World above = inclined(1.01 * critical, p.azimuth, p.cone, p.tilt);
  const double before = speedAfter(above, 0.6);
  const double gained = speedAfter(above, 0.4) - before;
  const double excess = 9.81 * 0.01 * critical * std::cos(std::atan(1.01 * critical)) * 0.4;
  EXPECT_GT(gained, 0.5 * excess);
}

TEST_P(OnIncline, SlidesWithTheRightAccelerationWithinTwoPercent) {
  const Incline& p = GetParam();
  const double slope = 1.6 * kFriction;
  World world = inclined(slope, p.azimuth, p.cone, p.tilt);
  const double before = speedAfter(world, 0.4);
  const double gained = speedAfter(world, 0.4) - before;
  const double cosine = std::cos(std::atan(slope));
  const double expected = 9.81 * cosine * (slope - p.effective * kFriction);
  EXPECT_NEAR(gained / 0.4, expected, 0.02 * expected);
  // friction is at its limit, and along the fall line
  const ContactForce f = contactForce(world, 0);
  EXPECT_NEAR(f.normal, world.body(0).model.totalMass() * 9.81 * cosine, 0.01 * f.normal);
}

const FrictionCone kExact{true, 8};
const FrictionCone kEight{false, 8};
const FrictionCone kFour{false, 4};

INSTANTIATE_TEST_SUITE_P(
    Cones, OnIncline,
    ::testing::Values(Incline{"exact_along_x", kExact, 0.0, 1.0, Tilt::gravity},
                      Incline{"exact_off_axis", kExact, 0.9, 1.0, Tilt::gravity},
                      Incline{"exact_tilted_plane", kExact, 0.0, 1.0, Tilt::plane},
                      Incline{"eight_facets_aligned", kEight, 0.0, 1.0, Tilt::gravity},
                      Incline{"eight_facets_aligned_y", kEight, M_PI / 2, 1.0, Tilt::gravity},
                      Incline{"eight_facets_tilted_plane", kEight, 0.0, 1.0, Tilt::plane},
                      Incline{"eight_facets_between", kEight, M_PI / 8, std::cos(M_PI / 8), Tilt::gravity},
                      Incline{"four_facets_aligned", kFour, 0.0, 1.0, Tilt::gravity},
                      Incline{"four_facets_between", kFour, M_PI / 4, std::cos(M_PI / 4), Tilt::gravity}),
    [](const auto& incline) { return std::string(incline.param.name); });

// In every contact of every step friction takes power, and the whole body never gains energy from sliding. The
// semi-implicit step itself may add a little while elements turn, hence the allowance.
TEST(Friction, NeverAddsEnergy) {
  for (const bool exact : {false, true}) {
    World world;
    world.contact.cone.exact = exact;
    world.obstacles = {ground(kFriction)};
    Vec6 velocity;
    velocity << 0.8, 0.5, -0.3, 0, 0, 6;
    world.add(bar({3, 3, 2}, {}, kFriction, velocity));
    const double start = mechanicalEnergy(world, 0);
    double before = start;
    for (int n = 0; n < 80; ++n) {
      ASSERT_EQ(world.step({}, kStep).status, StepStatus::ok);
      const ContactSet& set = world.contacts();
      if (!set.contacts.empty()) {
        const VecX velocities = set.rowVelocity();
        for (Eigen::Index i = 0; i < velocities.size(); i += 3) {
          EXPECT_LE(set.impulse.segment<2>(i + 1).dot(velocities.segment<2>(i + 1)), 1e-14);
        }
      }
      const double now = mechanicalEnergy(world, 0);
      EXPECT_LT(now, before + 1e-3 * start);
      before = now;
    }
    EXPECT_LT(world.body(0).model.kineticEnergy(world.body(0).state), 1e-3 * start);
  }
}

}  // namespace
}  // namespace palpate
