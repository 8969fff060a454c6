// A handle that follows a path: World::follow().
#include <gtest/gtest.h>

#include "palpate/math/rotation.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kStep = 0.033;

struct Held {
  World world;
  /// @param more  mass of the handle [kg]
  explicit Held(double height, double more = 0.0) {
    Material material;
    material.youngs_modulus = 2e4;
    material.damping_beta = 0.002;
    BodyModel body = bar({4, 3, 3}, material);
    HandleOptions handle = kPlainHandle;
    handle.mass += more;
    holdNodes(body, onTop, handle);
    world.obstacles = {ground()};
    world.add(std::move(body));
    Pose start = world.tool().state.handle.pose;
    start.position.z() += height;
    world.setHandle(0, {start, Vec6::Zero()});
    BodyState raised = world.tool().state;
    for (const int n : world.tool().model.free()) raised.positions[3 * n + 2] += height;
    world.setBody(0, raised);
  }
};

ToolPath straight(const Pose& from, const Vec6& twist, double step) {
  ToolPath path;
  for (int k = 0; k <= 33; ++k) path.points.push_back({advance(from, step * k / 33.0 * twist), twist});
  return path;
}

TEST(Follow, TheHandleIsWhereThePathEnds) {
  Held held(0.1);
  Vec6 twist;
  twist << 0.2, -0.1, 0.05, 2.0, 1.0, -3.0;
  for (int k = 0; k < 20; ++k) {
    const ToolPath path = straight(held.world.tool().state.handle.pose, twist, kStep);
    ASSERT_EQ(held.world.follow(path, kStep).status, StepStatus::ok);
    const HandleState& handle = held.world.tool().state.handle;
    EXPECT_LT(poseDifference(handle.pose, path.points.back().pose).norm(), 1e-12);
    EXPECT_LT((handle.twist - twist).norm(), 1e-12);
  }
}

// A tool without weight that is turned quickly and evenly ends up as a rigid body does but for the centrifugal load:
// turning is no strain.
TEST(Follow, TurningAloneStrainsNothing) {
  Held held(0.1);
  held.world.gravity.setZero();
  Vec6 twist;
  twist << Vec3::Zero(), 0, 0, 0.5;
  StepReport report;
  for (int k = 0; k < 60; ++k) {
    report = held.world.follow(straight(held.world.tool().state.handle.pose, twist, kStep), kStep);
  }
  // centrifugal strain is of the order rho w^2 L^2 / E = 5e-6; its energy E V strain^2 / 2
  EXPECT_LT(report.elastic_energy, 1e-9);
}

// Led on the way that it is on already, evenly, up and down, once with 0.3 kg more in the handle: nobody makes energy,
// and the path is kept to. Who leads the handle carries its weight.
TEST(Follow, LiftingMakesNoEnergy) {
  for (const double more : {0.0, 0.3}) {
    for (const double speed : {0.3, -0.3}) {
      Held held(0.6, more);
      Vec6 twist = Vec6::Zero();
      twist[2] = speed;
      held.world.settle({0}, held.world.tool().state.handle.pose);
      double made = 0;
      for (int k = 0; k < 40; ++k) {
        const StepReport report = held.world.follow(straight(held.world.tool().state.handle.pose, twist, kStep), kStep);
        ASSERT_EQ(held.world.state().pulled_after, 0) << "left the path, step " << k << ", speed " << speed;
        made += report.energy_made;
      }
      EXPECT_EQ(made, 0) << more << " kg, " << speed << " m/s";
    }
  }
}

TEST(Follow, LiftingARigidToolMakesNoEnergy) {
  for (const double speed : {0.3, -0.3}) {
    World world;
    BodyModel ball = BodyModel::rigid("probe", sphereSurface(0.01), 2000);
    ball.holdRigid("grip", 0.3, Vec3::Zero(), expRotation({0.3, -0.2, 0.1}));
    world.add(std::move(ball));
    Vec6 twist = Vec6::Zero();
    twist[2] = speed;
    for (int k = 0; k < 10; ++k) {
      const StepReport report = world.follow(straight(world.tool().state.handle.pose, twist, kStep), kStep);
      EXPECT_EQ(report.energy_made, 0) << "step " << k << ", speed " << speed;
      EXPECT_EQ(world.state().pulled_after, 0) << "left the path, step " << k << ", speed " << speed;
    }
  }
}

// A correction that lifts the free nodes by a millimeter brings their weight's energy, in the step's account as well.
TEST(Follow, CorrectionsLiftWeight) {
  for (const double way : {1e-3, -1e-3}) {
    Held held(0.1);
    held.world.settle({0}, held.world.tool().state.handle.pose);
    const BodyModel& tool = held.world.tool().model;
    ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
    path.shift = VecX::Zero(3 * tool.freeNodes());
    double mass = 0;
    for (int r = 0; r < tool.freeNodes(); ++r) {
      path.shift[3 * r + 2] = way;
      mass += tool.elasticity().mass()[tool.free()[r]];
    }
    const double flat = held.world.gravity.norm() * mass * way;
    const WorldState start = held.world.state();
    const double with = held.world.follow(path, kStep).energy_corrected;
    held.world.restore(start);
    held.world.gravity.setZero();
    EXPECT_NEAR(with - held.world.follow(path, kStep).energy_corrected, flat, 1e-3 * std::abs(flat));
  }
}

// A path into the ground: the free nodes stay above it whatever the handle does, and the handle stops where the ground
// is.
TEST(Follow, ContactStopsTheHandle) {
  Held held(0.01);
  Vec6 twist = Vec6::Zero();
  twist[2] = -0.3;
  Pose at = held.world.tool().state.handle.pose;
  for (int k = 0; k < 12; ++k) {  // 12 cm down, 3 cm of it through the ground
    const ToolPath path = straight(at, twist, kStep);
    at = path.points.back().pose;
    const StepReport report = held.world.follow(path, kStep);
    EXPECT_NE(report.status, StepStatus::restored);
    ASSERT_LT(deepestVertex(held.world, 0), 5e-4) << k;
  }
  EXPECT_TRUE(held.world.tool().state.isFinite());
}

TEST(Follow, CorrectionsEnterWithTheStep) {
  Held held(0.1);
  held.world.gravity.setZero();
  const BodyModel& tool = held.world.tool().model;
  ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
  path.shift = VecX::Constant(3 * tool.freeNodes(), 1e-4);
  const VecX before = held.world.tool().state.positions;
  ASSERT_EQ(held.world.follow(path, 1e-6).status, StepStatus::ok);  // no time for anything else
  double least = 1, most = 0;
  for (const int n : tool.free()) {
    const Vec3 moved = held.world.tool().state.positions.segment<3>(3 * n) - before.segment<3>(3 * n);
    least = std::min(least, moved.minCoeff());
    most = std::max(most, moved.maxCoeff());
  }
  EXPECT_NEAR(least, 1e-4, 1e-8);
  EXPECT_NEAR(most, 1e-4, 1e-8);
  EXPECT_LT(held.world.tool().state.velocities.cwiseAbs().maxCoeff(), 1e-2);  // not 100 m/s: it is no motion
}

// What was prepared in the handle's frame gives the step that the world's frame gives: pressed on the ground, with a
// shift, while the handle turns.
TEST(Follow, APreparedStepIsTheSame) {
  Held held(0.002);
  Vec6 twist;
  twist << 0, 0, -0.15, 0, 0, 0;
  for (int k = 0; k < 3; ++k) {
    ASSERT_EQ(held.world.follow(straight(held.world.tool().state.handle.pose, twist, kStep), kStep).status,
              StepStatus::ok);
  }
  twist << 0.02, -0.01, 0, 0.2, 0.1, -0.6;
  const BodyModel& tool = held.world.tool().model;
  for (int k = 0; k < 4; ++k) {
    ToolPath path = straight(held.world.tool().state.handle.pose, twist, kStep);
    path.shift = VecX::Constant(3 * tool.freeNodes(), k * 1e-4);
    const WorldState start = held.world.state();
    VecX places = tool.placesInHandle(start.bodies[0]);
    for (const int n : tool.free()) places.segment<3>(3 * n) += Vec3::Constant(k * 1e-4);
    held.world.restore(start);  // nothing is prepared
    ASSERT_EQ(held.world.follow(path, kStep).status, StepStatus::ok);
    const VecX expected = held.world.tool().state.positions;
    const Vec6 wrench = held.world.tool().system.wrenchOnHandle(held.world.tool().state);
    held.world.restore(start);
    ASSERT_TRUE(held.world.tool().system.prepareFollowing(places, start.bodies[0], kStep));
    const StepReport report = held.world.follow(path, kStep);
    EXPECT_TRUE(held.world.tool().system.prepared().ready) << "it was not used";
    EXPECT_EQ(report.status, StepStatus::ok);
    EXPECT_GT(report.active, 0);
    EXPECT_LT((held.world.tool().state.positions - expected).norm(), 1e-9);
    EXPECT_LT((held.world.tool().system.wrenchOnHandle(held.world.tool().state) - wrench).norm(), 1e-6);
  }
}

}  // namespace
}  // namespace palpate
