// A handle that follows a path: World::follow().
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "palpate/math/rotation.h"
#include "shared/held_scenes.h"
#include "shared/pair_scenes.h"

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

// On the ground, by 6 mm; then at rest.
void press(Held& held) {
  Vec6 down = Vec6::Zero();
  down[2] = -0.006 / (10 * kStep);
  for (int k = 0; k < 30; ++k) {
    const Vec6 twist = k < 10 ? down : Vec6(Vec6::Zero());
    ASSERT_FALSE(held.world.follow(straight(held.world.tool().state.handle.pose, twist, kStep), kStep).failed());
  }
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

// Turned once round, by a third of a radian in a step: the weight's lever changes within a step by more than a
// hundredth.
TEST(Follow, TurningAWeightMakesNoEnergy) {
  for (const double speed : {3.0, 10.0, -10.0}) {
    Held held(0.6);
    Vec6 twist = Vec6::Zero();
    twist[4] = speed;
    held.world.settle({0}, held.world.tool().state.handle.pose);
    double made = 0;
    for (int k = 0; k * kStep * std::abs(speed) < 2 * std::numbers::pi; ++k) {
      const StepReport report = held.world.follow(straight(held.world.tool().state.handle.pose, twist, kStep), kStep);
      EXPECT_EQ(held.world.state().pulled_after, 0) << "left the path, step " << k << ", " << speed << " rad/s";
      made += report.energy_made;
    }
    EXPECT_EQ(made, 0) << speed << " rad/s";
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
    const StepReport report = held.world.follow(path, kStep);
    EXPECT_EQ(report.corrected_share, 1.0);
    const double with = report.energy_corrected;
    held.world.restore(start);
    held.world.gravity.setZero();
    EXPECT_NEAR(with - held.world.follow(path, kStep).energy_corrected, flat, 1e-3 * std::abs(flat));
  }
}

// Where the path leads where the scene forbids, the link pulls, and the correction waits for the next model: the step
// says so, in the step that leaves the path and in those after it.
TEST(Follow, APulledStepBringsNoCorrection) {
  Held held(0.1);
  held.world.gravity.setZero();
  ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
  path.shift = VecX::Zero(3 * held.world.tool().model.freeNodes());
  path.shift[2] = 0.004;    // of one node: it costs more than any work explains, and is given back at once
  path.largest_force = -1;  // and any force is too much
  for (int n = 0; n < 2; ++n) {
    const VecX before = held.world.tool().state.positions;
    const StepReport report = held.world.follow(path, kStep);
    ASSERT_GT(held.world.state().pulled_after, 0);
    EXPECT_EQ(report.corrected_share, 0.0);
    EXPECT_EQ(report.energy_corrected, 0);
    EXPECT_LT((held.world.tool().state.positions - before).cwiseAbs().maxCoeff(), 1e-6);
  }
}

// Led 4 cm into the ground in a step, by who may push with 1 N, a tool is pulled instead, in parts as long as they
// would have been: what was tried leaves nothing behind but the order of a factor.
TEST(Follow, WhatContactResistsIsPulled) {
  Held held(0.001);
  Vec6 down = Vec6::Zero();
  down[2] = -0.04 / kStep;
  ToolPath path = straight(held.world.tool().state.handle.pose, down, kStep);
  path.largest_force = 1.0;
  WorldState start = held.world.state();
  start.pulled_steps = 1;
  held.world.restore(start);
  const StepReport pulled = held.world.follow(path, kStep);
  const WorldState expected = held.world.state();
  ASSERT_GT(pulled.active, 0);
  start.pulled_steps = 0;
  held.world.restore(start);
  const StepReport report = held.world.follow(path, kStep);
  EXPECT_GT(held.world.state().pulled_after, 0);
  EXPECT_EQ(report.parts, pulled.parts);
  EXPECT_LT((held.world.tool().state.positions - expected.bodies[0].positions).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LT((held.world.tool().state.velocities - expected.bodies[0].velocities).cwiseAbs().maxCoeff(), 1e-6);
}

// Pressed on the ground, a tool is to be stretched again by what presses it: the ground does not let it, and the energy
// that this would have taken away is not made.
TEST(Follow, ABlockedCorrectionMakesNoEnergy) {
  Held held(0.0);
  ASSERT_NO_FATAL_FAILURE(press(held));
  ASSERT_EQ(held.world.state().pulled_after, 0);
  ASSERT_GT(held.world.contacts().active(), 0);
  const BodyModel& tool = held.world.tool().model;
  const VecX before = held.world.tool().state.positions;
  ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
  path.shift = VecX::Zero(3 * tool.freeNodes());
  const double top = held.world.tool().state.handle.pose.position.z();
  for (int r = 0; r < tool.freeNodes(); ++r) {
    path.shift[3 * r + 2] = -0.005 * (top - before[3 * tool.free()[r] + 2]) / top;
  }
  const StepReport report = held.world.follow(path, kStep);
  EXPECT_EQ(report.corrected_share, 1.0);
  EXPECT_LT(report.energy_corrected, -1e-3);
  EXPECT_EQ(report.energy_made, 0);
  EXPECT_EQ(held.world.state().pulled_after, 0) << "left the path";
  for (int i = 0; i < tool.nodes(); ++i) EXPECT_GT(held.world.tool().state.positions[3 * i + 2], -1e-4);
}

// In parts of a step, the first of which brings motion, and all of which are to bring a stretch that the ground does
// not let in: what the one brought is not made, whatever the others were to take away.
TEST(Follow, WhatAPartBringsIsNotMadeInTheWhole) {
  Held held(0.0);
  ASSERT_NO_FATAL_FAILURE(press(held));
  const BodyModel& tool = held.world.tool().model;
  const VecX before = held.world.tool().state.positions;
  ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
  path.shift = path.velocity = VecX::Zero(3 * tool.freeNodes());
  const double top = held.world.tool().state.handle.pose.position.z();
  for (int r = 0; r < tool.freeNodes(); ++r) {
    const double below = (top - before[3 * tool.free()[r] + 2]) / top;
    path.shift[3 * r + 2] = -0.02 * below;
    path.velocity[3 * r] = 2.0 * below;
  }
  const double start =
      held.world.follow(straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep), kStep).elastic_energy;
  const StepReport report = held.world.follow(path, kStep, 4);
  ASSERT_EQ(held.world.state().pulled_after, 0) << "left the path";
  EXPECT_GT(report.kinetic_energy + report.elastic_energy, 1.02 * start + std::max(0.0, report.energy_corrected));
  EXPECT_EQ(report.energy_made, 0);
}

// The same in parts of a step. Each brings its share: were all of it brought by the first, what the ground does not let
// in would be a velocity that the others go on with.
TEST(Follow, PartsBringACorrectionEvenly) {
  VecX ends[2];
  for (const int parts : {1, 4}) {
    Held held(0.0);
    ASSERT_NO_FATAL_FAILURE(press(held));
    const BodyModel& tool = held.world.tool().model;
    ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
    path.shift = VecX::Zero(3 * tool.freeNodes());
    for (int r = 0; r < tool.freeNodes(); ++r) path.shift[3 * r + 2] = -1e-3;
    const VecX before = held.world.tool().state.positions;
    const StepReport report = held.world.follow(path, kStep, parts);
    ASSERT_EQ(held.world.state().pulled_after, 0) << "left the path";
    EXPECT_EQ(report.corrected_share, 1.0);
    ends[parts == 1 ? 0 : 1] = held.world.tool().state.positions - before;
  }
  EXPECT_LT((ends[1] - ends[0]).cwiseAbs().maxCoeff(), 2e-4);
}

// A body that falls bends by gravity. The next step is taken in parts that bend by no more than is wanted: as many as
// halves of halves are needed, and as cost little.
TEST(Follow, WhatBendsIsTakenInParts) {
  constexpr double kGravity = 9.81;
  Material material;
  material.youngs_modulus = 2e4;
  Held held(0.1);
  held.world.add(BodyModel(
      "other", moved(barMesh({0.04, 0.04, 0.04}, {2, 2, 2}), {Vec3(0.3, 0, 0.5), Quat::Identity()}), material));
  held.world.settle({0}, held.world.tool().state.handle.pose);
  ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
  ASSERT_EQ(held.world.follow(path, kStep).status, StepStatus::ok);
  EXPECT_NEAR(held.world.state().bending, kGravity, 1e-3);
  const WorldState start = held.world.state();
  const auto endOf = [&](double bend, int parts, double operations) {
    held.world.restore(start);
    held.world.budget.operations = operations;
    path.largest_bend = bend;
    const StepReport report = held.world.follow(path, kStep, parts);
    EXPECT_EQ(report.status, StepStatus::ok);
    EXPECT_EQ(report.redone, 0) << "from the start, and not because something failed";
    EXPECT_FALSE(report.out_of_budget);
    return VecX(held.world.body(1).state.positions);
  };
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double bend = kGravity * kStep * kStep;
  for (const auto& [share, parts] : {std::pair{1.1, 1}, {0.9, 2}, {0.2, 4}, {1e-6, 8}}) {
    EXPECT_EQ(endOf(share * bend, 1, kInfinity), endOf(kInfinity, parts, kInfinity)) << parts;
  }
  const double little = 2.0 * start.part_cost;
  EXPECT_EQ(endOf(0.2 * bend, 1, little), endOf(kInfinity, 1, little)) << "four would cost too much";
}

// A body that nothing leads is corrected: it ends up shifted and faster by that, with the energy that it brings in the
// account; a correction is no motion.
TEST(Follow, OtherBodiesAreCorrected) {
  Material material;
  material.youngs_modulus = 2e4;
  Held held(0.1);
  held.world.gravity.setZero();
  held.world.add(BodyModel(
      "other", moved(barMesh({0.04, 0.04, 0.04}, {2, 2, 2}), {Vec3(0.3, 0, 0.5), Quat::Identity()}), material));
  const int n = held.world.body(1).model.freeNodes();
  ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
  ASSERT_EQ(held.world.follow(path, kStep).status, StepStatus::ok);
  const VecX before = held.world.body(1).state.positions;
  const Vec3 shift(1e-3, -2e-3, 3e-3), faster(0.1, 0.2, -0.3);
  path.others = {{1, shift.replicate(n, 1), faster.replicate(n, 1)}};
  const StepReport report = held.world.follow(path, kStep);
  ASSERT_EQ(report.status, StepStatus::ok);
  const BodyState& after = held.world.body(1).state;
  for (int i = 0; i < n; ++i) {
    EXPECT_LT(((after.positions - before).segment<3>(3 * i) - shift - kStep * faster).norm(), 1e-9);
    EXPECT_LT((after.velocities.segment<3>(3 * i) - faster).norm(), 1e-9);
  }
  const double kinetic = 0.5 * held.world.body(1).model.totalMass() * faster.squaredNorm();
  EXPECT_NEAR(report.energy_corrected, kinetic, 1e-6 * kinetic);
  EXPECT_EQ(report.energy_made, 0);
}

TEST(Follow, RigidBodiesAreCorrected) {
  Held held(0.1);
  held.world.gravity.setZero();
  held.world.add(
      BodyModel::rigid("other", placed(boxSurface({0.04, 0.03, 0.02}), {Vec3(0.3, 0, 0.5), Quat::Identity()}), 1000));
  ToolPath path = straight(held.world.tool().state.handle.pose, Vec6::Zero(), kStep);
  ASSERT_EQ(held.world.follow(path, kStep).status, StepStatus::ok);
  const Pose before = held.world.body(1).state.handle.pose;
  Vec6 shift, faster;
  shift << 1e-3, -2e-3, 3e-3, 0.01, 0, 0;
  faster << 0.1, 0.2, -0.3, 0, 0, 0.5;
  path.others = {{1, shift, faster}};
  const StepReport report = held.world.follow(path, kStep);
  ASSERT_EQ(report.status, StepStatus::ok);
  const BodyState& after = held.world.body(1).state;
  EXPECT_LT((poseDifference(after.handle.pose, before) - shift - kStep * faster).norm(), 1e-9);
  EXPECT_LT((after.handle.twist - faster).norm(), 1e-9) << "a correction is no motion";
  EXPECT_GT(report.energy_corrected, 0.5 * held.world.body(1).model.totalMass() * faster.head<3>().squaredNorm());
  EXPECT_EQ(report.energy_made, 0);
}

// Springs to the world on a tool that is led are where its nodes are, not where they were: what moves it adds up.
TEST(Follow, SpringsOnALedToolAddUp) {
  Material material;
  material.youngs_modulus = 2e4;
  material.damping_beta = 0.002;
  BodyModel body = bar({4, 3, 3}, material);
  holdNodes(body, onTop, kPlainHandle);
  Attachment springs;
  springs.name = "springs";
  springs.nodes = nodesWhere(body.mesh().mesh.nodes, [](const Vec3& p) { return p.z() < 1e-9; });
  const auto count = static_cast<Eigen::Index>(springs.nodes.size());
  springs.stiffness = VecX::Constant(count, 100.0 / static_cast<double>(count));
  springs.damping = VecX::Constant(count, 5.0 / static_cast<double>(count));
  body.attach(springs);
  World world;
  world.gravity.setZero();
  world.add(std::move(body));
  Vec6 twist = Vec6::Zero();
  twist[0] = 0.1;
  const BodyModel& tool = world.tool().model;
  const auto momentum = [&] {
    Vec3 sum = Vec3::Zero();
    for (const int i : tool.free())
      sum += tool.elasticity().mass()[i] * world.tool().state.velocities.segment<3>(3 * i);
    return sum;
  };
  for (int k = 0; k < 20; ++k) {
    const Vec3 before = momentum();
    ASSERT_EQ(world.follow(straight(world.tool().state.handle.pose, twist, kStep), kStep).status, StepStatus::ok);
    const Vec3 springs_give = world.tool().system.attachmentForces()[0].force;
    const Vec3 handle_gives = -world.tool().system.wrenchOnHandle(world.tool().state).head<3>();
    if (k < 3) continue;  // it starts at once, and what is soft cannot
    EXPECT_LT(((momentum() - before) / kStep - springs_give - handle_gives).norm(), 0.02 + 0.02 * springs_give.norm())
        << k;
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
