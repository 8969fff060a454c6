// Soft, thin, tensioned and spinning things at steps of 33 ms, ten seconds long: they make no energy, and what nothing
// drives comes to rest.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "shared/held_scenes.h"

namespace palpate::test {
namespace {

constexpr double kStep = 0.033;  // [s]
constexpr int kSteps = 303;      // ten seconds

Material softWithoutDamping(double youngs_modulus) {
  Material m;
  m.youngs_modulus = youngs_modulus;
  m.poisson_ratio = 0.3;
  m.density = 1000;
  m.damping_alpha = m.damping_beta = 0;
  return m;
}

// At rest.
World hanging(const Vec3& size, const std::array<int, 3>& cells, double youngs_modulus) {
  World world = hangingBar(size, cells, softWithoutDamping(youngs_modulus));
  world.link = {1e4, 20, 100, 0.1};
  world.settle({0}, world.tool().state.handle.pose);
  return world;
}

// Swung by its handle for three seconds, held still for seven.
void swing(World& world, const Vec3& amplitude, double frequency) {
  constexpr double kSwung = 3.0;
  const Pose home = world.tool().state.handle.pose;
  double largest = 0, last = 0;
  for (int k = 1; k <= kSteps; ++k) {
    const double t = k * kStep, phase = 2 * std::numbers::pi * frequency * t;
    DeviceTarget device{home, Vec6::Zero()};
    if (t < kSwung) {
      device.pose.position += std::sin(phase) * amplitude;
      device.twist.head<3>() = 2 * std::numbers::pi * frequency * std::cos(phase) * amplitude;
    }
    const StepReport report = world.step(device, kStep);
    ASSERT_TRUE(report.sound()) << t;
    ASSERT_LE(report.energy_made, 1e-5) << t;
    largest = std::max(largest, report.kinetic_energy);
    last = report.kinetic_energy;
  }
  EXPECT_GT(largest, 1e-5);         // it did move
  EXPECT_LT(last, 0.05 * largest);  // undamped: the integrator alone takes it
}

TEST(Flutter, ARopeThatIsSwungComesToRest) {
  World rope = hanging(Vec3(0.006, 0.006, 0.3), {1, 1, 30}, 1e5);
  swing(rope, Vec3(0.05, 0, 0), 1.5);
}

TEST(Flutter, ASheetThatIsWavedComesToRest) {
  World sheet = hanging(Vec3(0.15, 0.003, 0.15), {8, 1, 8}, 5e4);
  swing(sheet, Vec3(0, 0.04, 0), 2.0);
}

// About its middle axis, which is unstable, with nothing to stop it: it tumbles, and gains nothing.
TEST(Flutter, ABarThatSpinsGainsNothing) {
  World world;
  world.gravity.setZero();
  Vec6 twist = Vec6::Zero();
  twist.tail<3>() = Vec3(0.2, 30.0, 0.2);
  world.add(BodyModel("bar", barMesh(Vec3(0.1, 0.03, 0.06), {6, 2, 4}), softWithoutDamping(2e4), 0.5, twist));
  double lowest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kSteps; ++k) {
    const StepReport report = world.step({}, kStep);
    ASSERT_TRUE(report.sound()) << k;
    const double energy = report.kinetic_energy + report.elastic_energy;
    ASSERT_LE(energy, 1.01 * lowest + 1e-5) << k;
    lowest = std::min(lowest, energy);
  }
}

}  // namespace
}  // namespace palpate::test
