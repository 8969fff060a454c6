// Steps that are done again in shorter ones, that end early, and what their energy is judged by.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "shared/pair_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kStep = 0.033;

// A held bar that is thrown at the ground and turned meanwhile.
struct Thrown {
  World world;
  Pose start;

  Thrown() {
    Material material;
    material.youngs_modulus = 2e4;
    material.damping_beta = 0.005;
    BodyModel body = bar({6, 4, 3}, material);
    holdNodes(body, onTop, kPlainHandle);
    world.link = {700, 5, 1.0, 0.005};
    world.obstacles = {ground()};
    world.add(std::move(body), true);
    start = world.tool().state.handle.pose;
    start.position.z() += 0.05;
    world.setHandle(0, {start, Vec6::Zero()});
    BodyState raised = world.tool().state;
    for (const int n : world.tool().model.free()) raised.positions[3 * n + 2] += 0.05;
    world.setBody(0, raised);
  }
  DeviceTarget target(int n) const {
    const double t = kStep * n;
    Vec6 way;
    way << 0.03 * std::sin(11 * t), 0.03 * std::sin(17 * t), -0.06 * std::sin(9 * t), 0.9 * std::sin(10 * t),
        0.7 * std::sin(13 * t), 0;
    return {advance(start, way), Vec6::Zero()};
  }
};

double energy(const StepReport& report) { return report.kinetic_energy + report.elastic_energy; }

TEST(Redo, EnergyIsExplainedByWork) {
  Thrown thrown;
  double made = 0, largest = 0;
  int redone = 0;
  for (int n = 0; n < 150; ++n) {
    const StepReport report = thrown.world.step(thrown.target(n), kStep);
    ASSERT_NE(report.status, StepStatus::restored);
    made += report.energy_made;
    largest = std::max(largest, energy(report));
    redone += report.redone > 0 ? 1 : 0;
  }
  EXPECT_GT(redone, 0);
  EXPECT_GT(largest, 0.01);
  EXPECT_LT(made, 0.05 * largest);
}

TEST(Redo, EndsEarlyWhereTheBudgetIsUsedUp) {
  Thrown full, cut;
  cut.world.budget.operations = 1;
  bool early = false;
  for (int n = 0; n < 80; ++n) {
    const StepReport all = full.world.step(full.target(n), kStep);
    EXPECT_FALSE(all.out_of_budget);
    const StepReport some = cut.world.step(cut.target(n), kStep);
    EXPECT_EQ(some.out_of_budget, some.out_of_budget && some.motion_share < 1);
    EXPECT_GE(some.motion_share, 0.0);
    EXPECT_TRUE(cut.world.tool().state.isFinite());
    early |= some.out_of_budget;
  }
  EXPECT_TRUE(early);
}

// Forces of a link and of gravity along a given motion, by hand.
TEST(Redo, WorkIsForceTimesWay) {
  World world;
  world.gravity = Vec3(0, 0, -10);
  world.link = {100, 0, 1, 0};
  BodyModel body = bar({2, 2, 2}, Material{});
  holdNodes(body, onTop, kPlainHandle);
  world.add(std::move(body));
  const double mass = world.tool().model.totalMass();
  DeviceTarget device{world.tool().state.handle.pose, Vec6::Zero()};
  device.pose.position.x() += 0.01;
  const Vec3 before = center(world.tool());
  const Pose handle = world.tool().state.handle.pose;
  ASSERT_EQ(world.step(device, 0.01).status, StepStatus::ok);
  const Vec6 motion = poseDifference(world.tool().state.handle.pose, handle);
  const Vec6 stretch = poseDifference(device.pose, world.tool().state.handle.pose);
  const Vec3 way = motion.head<3>();
  const double of_link = 100 * stretch.head<3>().dot(way) + stretch.tail<3>().dot(motion.tail<3>());
  const StepWork work = workOn(world.tool().system, world.tool().state);
  const double fallen = (center(world.tool()) - before).z();
  const double own = world.tool().model.handle().mass - world.tool().model.handle().attached_mass;
  const double soft = mass - own;
  EXPECT_NEAR(work.sum, -10 * (soft * fallen + own * way.z()) + of_link, 1e-9);
  EXPECT_GE(work.magnitudes, std::abs(work.sum));
  EXPECT_DOUBLE_EQ(energyMade(1.0, 2.0, {0.5, 0.7}), 0.5 - 0.017);
  EXPECT_DOUBLE_EQ(energyMade(1.0, 2.0, {0.5, 0.7}, 0.5), 0.5 - 0.012);
  EXPECT_EQ(energyMade(2.0, 2.4, {0.5, 0.5}), 0.0);
}

// A part of a step leads where the device was at that time, not at once to where it will be.
TEST(Redo, PartsFollowTheDevice) {
  const DeviceTarget from{at(Vec3(0, 0, 0)), moving(Vec3(1, 0, 0))};
  DeviceTarget to{at(Vec3(0.2, 0, 0)), moving(Vec3(3, 0, 0))};
  to.pose.rotation = expRotation(Vec3(0, 0, 1.0));
  const DeviceTarget half = between(from, to, 0.5);
  EXPECT_NEAR((half.pose.position - Vec3(0.1, 0, 0)).norm(), 0, 1e-15);
  EXPECT_NEAR(logRotation(half.pose.rotation).z(), 0.5, 1e-14);
  EXPECT_NEAR(half.twist[0], 2.0, 1e-15);
}

}  // namespace
}  // namespace palpate
