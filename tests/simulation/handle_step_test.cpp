// The handle in the step: static wrench, Newton's law, conservation, contact on its own surface.
#include <gtest/gtest.h>

#include <cmath>

#include "palpate/linearization/linearize.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

World heldBar(double alpha = 0.0) {
  Material material;
  material.damping_alpha = alpha;
  World world;
  world.link = {700, 2, 1.0, 0.01};
  BodyModel body = bar({3, 2, 3}, material);
  holdNodes(body, onTop);
  world.add(std::move(body));
  return world;
}

TEST(HandleStep, WrenchAtRestIsTheFreeNodesWeightAndMoment) {
  World world = heldBar();
  Pose device = world.tool().state.handle.pose;
  device.rotation = expRotation({0.4, 0.7, -0.2}) * device.rotation;  // hangs askew, so that there is a moment
  world.settle({0}, device);
  ASSERT_EQ(world.evaluate({device, Vec6::Zero()}, 0.033).status, StepStatus::ok);
  const Body tool = world.tool();
  Vec6 expected = Vec6::Zero();
  for (int i = 0; i < tool.model.nodes(); ++i) {
    if (tool.model.row()[i] < 0) continue;
    const Vec3 weight = tool.model.elasticity().mass()[i] * world.gravity;
    expected.head<3>() += weight;
    expected.tail<3>() += (tool.state.positions.segment<3>(3 * i) - tool.state.handle.pose.position).cross(weight);
  }
  const Vec6 wrench = couplingWrench(world);
  EXPECT_GT(expected.tail<3>().norm(), 1e-3 * expected.head<3>().norm() * kBarSize.z());
  EXPECT_LT((wrench - expected).head<3>().norm(), 1e-6 * expected.head<3>().norm());
  EXPECT_LT((wrench - expected).tail<3>().norm(), 1e-6 * expected.tail<3>().norm());
}

// M_h (u - u0) = h (Fc + weight - w0 x I w0 - link at the end of the step - drag), in free motion, in contact of the
// free nodes and in contact of the handle's own surface.
TEST(HandleStep, NewtonsLawOfTheHandle) {
  for (const bool upside_down : {false, true}) {
    constexpr double kAlpha = 0.4;
    Material material;
    material.damping_alpha = kAlpha;
    World world;
    world.link = {700, 2, 1.0, 0.01};
    world.obstacles = {ground(0.4)};
    BodyModel body = bar({3, 2, 3}, material);
    holdNodes(body, upside_down ? onBottom : onTop);
    world.add(std::move(body));
    const Body tool = world.tool();
    const Pose start = tool.state.handle.pose;
    constexpr double h = 0.01;
    int touching = 0;
    for (int n = 1; n <= 20; ++n) {
      Vec6 offset, speed;
      offset << 0.01, 0.005, 0.01 - 0.001 * n, 0.02 * n, 0.01 * n, 0;
      speed << 0, 0, -0.1, 2, 1, 0;
      const DeviceTarget device{advance(start, offset), speed};
      ASSERT_EQ(world.step(device, h).status, StepStatus::ok);
      touching += world.contacts().active() > 0 ? 1 : 0;
      const Pose& pose = tool.system.startPose();
      const Vec6 u0 = tool.system.startTwist();
      const Vec6 u = tool.system.endTwist();
      const Mat3 r = pose.matrix();
      const Mat3 inertia = r * tool.model.handle().inertia * r.transpose();
      const Vec3 w0 = u0.tail<3>();
      Vec6 wrench = couplingWrench(world);
      wrench.head<3>() += tool.model.handle().mass * world.gravity;
      wrench.tail<3>() -= w0.cross(inertia * w0);
      wrench.head<3>() -= kAlpha * tool.model.handle().attached_mass * u.head<3>();
      wrench.tail<3>() -= kAlpha * r * tool.model.handle().attached_inertia * r.transpose() * u.tail<3>();
      const Vec6 apart = poseDifference(pose, device.pose);
      const Mat3 jacobian = leftJacobianInverse(apart.tail<3>());
      wrench.head<3>() -=
          world.link.stiffness * (apart.head<3>() + h * u.head<3>()) + world.link.damping * (u - speed).head<3>();
      wrench.tail<3>() -= world.link.rotational_stiffness *
                              (apart.tail<3>() + 0.5 * h * (jacobian + jacobian.transpose()) * u.tail<3>()) +
                          world.link.rotational_damping * (u - speed).tail<3>();
      Vec6 change;
      change.head<3>() = tool.model.handle().mass * (u - u0).head<3>();
      change.tail<3>() = inertia * (u - u0).tail<3>();
      const double scale = h * (wrench.norm() + couplingWrench(world).norm());
      EXPECT_LT((change - h * wrench).norm(), 1e-9 * scale) << n;
    }
    EXPECT_GT(touching, 5);
  }
}

struct Drift {
  double linear, angular;
};
Drift spinDrift(double h) {
  World world;
  world.gravity.setZero();
  world.link = {0, 0, 0, 0};
  Material material;
  material.damping_beta = 0.01;
  Vec6 spin;
  spin << 0.1, 0, 0.05, 1.5, -2, 3;
  BodyModel body("bar", barMesh(kBarSize, {2, 2, 2}), material, 0.5, spin);
  HandleOptions handle;
  handle.twist = spin;  // the handle moves as the body does there
  const Vec3 arm = Vec3(0.5 * kBarSize.x(), 0.5 * kBarSize.y(), kBarSize.z()) - 0.5 * kBarSize;
  handle.twist.head<3>() += Vec3(spin.tail<3>()).cross(arm);
  holdNodes(body, onTop, handle);
  world.add(std::move(body));
  const auto angular = [&] {
    const Body tool = world.tool();
    const Handle& hd = tool.model.handle();
    Vec3 sum = tool.state.handle.pose.position.cross(hd.mass * Vec3(tool.state.handle.twist.head<3>())) +
               hd.worldInertia(tool.state.handle.pose) * tool.state.handle.twist.tail<3>();
    for (int i = 0; i < tool.model.nodes(); ++i) {
      if (tool.model.row()[i] < 0) continue;
      sum += tool.state.positions.segment<3>(3 * i).cross(tool.model.elasticity().mass()[i] *
                                                          tool.state.velocities.segment<3>(3 * i));
    }
    return sum;
  };
  const Vec3 l0 = angular();
  const Vec3 p0 = momentum(world.tool());
  const int steps = static_cast<int>(std::lround(0.2 / h));
  for (int n = 0; n < steps; ++n) EXPECT_EQ(world.step({}, h).status, StepStatus::ok);
  return {(momentum(world.tool()) - p0).norm() / p0.norm(), (angular() - l0).norm() / l0.norm()};
}

TEST(HandleStep, FreeMotionConservesMomentaToTheStepsOrder) {
  const Drift coarse = spinDrift(0.004);
  const Drift middle = spinDrift(0.002);
  const Drift fine = spinDrift(0.001);
  for (const Drift& d : {coarse, middle, fine}) EXPECT_LT(d.linear, 1e-11);
  EXPECT_LT(coarse.angular, 0.05);
  EXPECT_NEAR(coarse.angular / middle.angular, 2.0, 0.4);
  EXPECT_NEAR(middle.angular / fine.angular, 2.0, 0.4);
}

TEST(HandleStep, ContactOnTheHandlesOwnSurface) {
  World world;
  world.link = {700, 2, 1.0, 0.01};
  world.obstacles = {ground(0.5)};
  BodyModel body = bar({3, 2, 3}, {});
  holdNodes(body, onBottom);  // the surface that touches is the handle's own
  world.add(std::move(body));
  Pose device = world.tool().state.handle.pose;
  device.position.z() -= 0.005;
  world.settle({0}, device);
  ASSERT_EQ(world.step({device, Vec6::Zero()}, 0.01).status, StepStatus::ok);
  EXPECT_LT(deepestVertex(world, 0), 5e-5);
  // pressed by the link and the weight
  const double pressed = world.link.stiffness * (world.tool().state.handle.pose.position - device.position).z();
  EXPECT_NEAR(contactForce(world, 0).normal, pressed + 9.81 * world.tool().model.totalMass(), 1e-3 * pressed);
  EXPECT_NEAR(pressed, 700 * 0.005, 0.01);
}

// The handle turns by a quarter of a radian a step: its surface leaves the tangent, by more than a millimetre, and
// still must not sink in.
TEST(HandleStep, FastTurnOnTheHandlesOwnSurfaceDoesNotSinkIn) {
  World world;
  world.link = {700, 2, 5.0, 0.01};
  world.obstacles = {ground(0.2)};
  BodyModel body = bar({3, 2, 3}, {});
  holdNodes(body, onBottom);
  world.add(std::move(body));
  const Pose start = world.tool().state.handle.pose;
  constexpr double h = 0.033;
  for (int n = 1; n <= 30; ++n) {
    Vec6 offset = Vec6::Zero();
    offset[2] = -0.005;
    offset[4] = 0.6 * std::sin(8.0 / 0.6 * h * n);
    const StepReport report = world.step({advance(start, offset), Vec6::Zero()}, h);
    ASSERT_EQ(report.status, StepStatus::ok);
    EXPECT_LT(deepestVertex(world, 0), 5e-5) << n;
    EXPECT_NEAR(report.penetration, deepestVertex(world, 0), 1e-9);
  }
}

}  // namespace
}  // namespace palpate
