// A body that is linearized where it turns to.
#include <gtest/gtest.h>

#include "shared/held_scenes.h"

namespace palpate::test {
namespace {

// Of the body and its handle, about their center of mass.
Vec3 angularMomentum(const BodyModel& body, const BodyState& state) {
  const Handle& handle = body.handle();
  Vec3 center = handle.mass * state.handle.pose.position;
  for (const int i : body.free()) center += body.elasticity().mass()[i] * state.positions.segment<3>(3 * i);
  center /= body.totalMass();
  Vec3 sum = handle.worldInertia(state.handle.pose) * state.handle.twist.tail<3>() +
             handle.mass * (state.handle.pose.position - center).cross(state.handle.twist.head<3>());
  for (const int i : body.free()) {
    sum += body.elasticity().mass()[i] *
           (state.positions.segment<3>(3 * i) - center).cross(state.velocities.segment<3>(3 * i));
  }
  return sum;
}

// Nothing pulls at it.
StepInput letGo() {
  StepInput input;
  input.gravity.setZero();
  input.link.stiffness = input.link.damping = input.link.rotational_stiffness = input.link.rotational_damping = 0;
  input.turning = true;
  return input;
}

// A step that touches nothing.
void move(BodySystem& system, const StepInput& input, BodyState& state) {
  system.assemble(input, state);
  if (system.contactNodesFit({}) != OrderFit::good) system.orderContactNodes({});
  ASSERT_TRUE(system.factorize());
  system.solveFree();
  ASSERT_TRUE(system.advance());
}

// Let go, and turned by a third of a radian in each of thirty steps of 33 ms, with a handle at its middle or at its
// end: it keeps its shape but for the centrifugal load, its energy and, nearly, its angular momentum, which drifts most
// where it tumbles. Along straight ways it would grow by a twentieth in each step.
TEST(Turning, AFreeBarKeepsItsEnergyAndItsShape) {
  struct Case {
    Vec3 turning;
    double drift, loss, gain, strain;
  };
  const Vec3 size(0.06, 0.03, 0.1);
  Material material;
  material.youngs_modulus = 2e4;
  const StepInput input = letGo();
  for (const auto& [turning, drift, loss, gain, strain] :
       {Case{{0, 0, 10}, 0.05, 0.02, 0.005, 0.01}, Case{{0.2, 10, 0.2}, 0.08, 0.02, 0.005, 0.01},
        Case{{6, 0.2, 8}, 0.3, 0.06, 0.01, 0.02}}) {
    for (const double height : {0.5, 0.8, 1.0}) {
      SCOPED_TRACE(testing::Message() << turning.transpose() << ", handle at " << height);
      Vec6 twist;
      twist << 0.1, 0, 0, turning;
      BodyModel bar("thrown", barMesh(size, {4, 2, 6}), material, 0.5, twist);
      const Vec3 at(0.5 * size.x(), 0.5 * size.y(), height * size.z());
      HandleOptions options;
      options.mass = 1e-3;
      options.inertia = Vec3::Constant(1e-8);
      holdNodes(
          bar, [&](const Vec3& x) { return (x - at).cwiseAbs().maxCoeff() < 0.018; }, options);
      BodySystem system(bar);
      BodyState state = bar.startState();
      HandleState grip{state.handle.pose, twist};
      grip.twist.head<3>() += turning.cross(grip.pose.position - 0.5 * size);
      bar.setHandle(grip, state);
      const Vec3 before = angularMomentum(bar, state);
      const double energy = bar.kineticEnergy(state);
      for (int k = 0; k < 30; ++k) {
        SCOPED_TRACE(testing::Message() << "step " << k);
        ASSERT_NO_FATAL_FAILURE(move(system, input, state));
        const double moving = bar.kineticEnergy(state), elastic = system.elasticEnergy(state, 0.0);
        EXPECT_GT(moving, (1 - loss) * energy);
        EXPECT_LT(moving + elastic, (1 + gain) * energy);
        EXPECT_LT(elastic, strain * energy);
      }
      EXPECT_LT((angularMomentum(bar, state) - before).norm(), drift * before.norm());
    }
  }
}

// A bar that spins while it stretches turns slower, one that is pressed together turns faster: it keeps its angular
// momentum within a tenth of what its inertia changes, and makes no energy. With half of Coriolis' force it would be
// off by half of that.
TEST(Turning, WhatGrowsTurnsSlower) {
  const Vec3 size(0.02, 0.02, 0.1);
  Material material;
  material.youngs_modulus = 3e3;
  material.damping_alpha = material.damping_beta = 0;
  StepInput input = letGo();
  input.step = 0.002;
  for (const double apart : {8.0, -8.0}) {  // [1/s]
    SCOPED_TRACE(testing::Message() << "at " << apart << " /s");
    Vec6 twist;
    twist << 0, 0, 0, 12, 0, 0;
    BodyModel bar("thrown", barMesh(size, {2, 2, 10}), material, 0.5, twist);
    HandleOptions options;
    options.mass = 1e-4;
    options.inertia = Vec3::Constant(1e-9);
    holdNodes(
        bar, [&](const Vec3& x) { return std::abs(x.z() - 0.5 * size.z()) < 0.006; }, options);
    BodySystem system(bar);
    BodyState state = bar.startState();
    bar.setHandle({state.handle.pose, twist}, state);
    const double middle = state.handle.pose.position.z();
    for (const int i : bar.free()) {
      state.velocities[3 * i + 2] += apart * (state.positions[3 * i + 2] - middle);
    }
    const auto inertia = [&] {
      double sum = 0;
      for (const int i : bar.free()) {
        const Vec3 arm = state.positions.segment<3>(3 * i) - state.handle.pose.position;
        sum += bar.elasticity().mass()[i] * arm.tail<2>().squaredNorm();
      }
      return sum;
    };
    const Vec3 before = angularMomentum(bar, state);
    const double shape = inertia();
    double energy = bar.kineticEnergy(state), most = 0;
    for (int k = 0; k < 14; ++k) {
      ASSERT_NO_FATAL_FAILURE(move(system, input, state));
      const double now = bar.kineticEnergy(state) + system.elasticEnergy(state, 0.0);
      EXPECT_LT(now, 1.002 * energy) << "step " << k;
      energy = now;
      const double grown = inertia() / shape - 1;
      most = std::max(most, std::abs(grown));
      EXPECT_LT((angularMomentum(bar, state) - before).norm(), (0.1 * most + 0.01) * before.norm()) << "step " << k;
    }
    EXPECT_GT(most, 0.1);
  }
}

}  // namespace
}  // namespace palpate::test
