#include "palpate/one_d/model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace palpate::one_d {
namespace {

constexpr double kStep = 0.01;

ToolState freeState() { return {{0.31, -0.4}, {0.205, -0.35}}; }
ToolState wallState() { return {{0.08, -0.2}, {0.001, -0.5}}; }
PointState deviceNear(const ToolState& state) { return {state.handle.x - 0.006, -0.4}; }

double couplingAfter(const Parameters& p, ToolState start, const PointState& device, double dx, double dv) {
  start.handle.x += dx;
  start.handle.v += dv;
  return visualStep(p, start, device, kStep).coupling;
}

/// The step is linear while its active set stands, so a large difference has no truncation error.
void expectModelMatchesDifferences(const Parameters& p, const ToolState& start) {
  const PointState device = deviceNear(start);
  const StepResult result = visualStep(p, start, device, kStep);
  const ForceModel model = linearize(p, start, result, kStep);
  const double d = 1e-3;
  for (const double sign : {-1.0, 1.0}) {
    ToolState moved = start;
    moved.handle.x += sign * d;
    ASSERT_EQ(visualStep(p, moved, device, kStep).wall_active, result.wall_active);
  }
  const double kx = (couplingAfter(p, start, device, d, 0) - couplingAfter(p, start, device, -d, 0)) / (2 * d);
  const double kv = (couplingAfter(p, start, device, 0, d) - couplingAfter(p, start, device, 0, -d)) / (2 * d);
  EXPECT_NEAR(model.kx, kx, 1e-9 * std::abs(kx));
  EXPECT_NEAR(model.kv, kv, 1e-9 * std::abs(kv));
  EXPECT_DOUBLE_EQ(model.force, couplingAfter(p, start, device, 0, 0));
  EXPECT_LT(std::abs(kx), p.spring_stiffness);  // the handle gives way to the link during the step
}

TEST(OneDModel, LinearizationMatchesCentralDifferencesInTheAir) { expectModelMatchesDifferences({}, freeState()); }

TEST(OneDModel, LinearizationMatchesCentralDifferencesAtTheWall) {
  ASSERT_TRUE(visualStep({}, wallState(), deviceNear(wallState()), kStep).wall_active);
  expectModelMatchesDifferences({}, wallState());
}

TEST(OneDModel, LinearizationMatchesForUnequalMassesAndSoftLink) {
  const Parameters p{0.2, 0.01, 900.0, 3.0, 0.1, 150.0, 0.7};
  expectModelMatchesDifferences(p, freeState());
  expectModelMatchesDifferences(p, wallState());
}

TEST(OneDModel, TheWallStiffensTheModel) {
  const auto stiffness = [](const ToolState& state) {
    const StepResult result = visualStep({}, state, deviceNear(state), kStep);
    return -linearize({}, state, result, kStep).kx;
  };
  EXPECT_GT(stiffness(wallState()), 1.05 * stiffness(freeState()));
}

TEST(OneDModel, WallContactIsComplementary) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  int active = 0;
  for (int i = 0; i < 2000; ++i) {
    const double tool = 0.01 * unit(random);
    const ToolState start{{tool + 0.05 + 0.1 * unit(random), unit(random) - 0.5}, {tool, 2.0 * unit(random) - 1.0}};
    const StepResult result = visualStep({}, start, {start.handle.x - 0.05, -0.2}, kStep);
    active += result.wall_active ? 1 : 0;
    EXPECT_GE(result.state.tool.x, 0.0);
    EXPECT_GE(result.wall_impulse, 0.0);
    EXPECT_EQ(result.wall_impulse * result.state.tool.x, 0.0);
  }
  // neither side of the law is left out: a tenth of the starts at least on each
  EXPECT_GT(active, 200);
  EXPECT_LT(active, 1800);
}

TEST(OneDModel, WallImpulseBalancesMomentum) {
  // Without link, momentum changes by the wall's impulse alone.
  Parameters p;
  p.link_stiffness = p.link_damping = 0.0;
  const ToolState start = wallState();
  const StepResult result = visualStep(p, start, {0.0, 0.0}, kStep);
  ASSERT_TRUE(result.wall_active);
  const auto momentum = [&](const ToolState& s) { return p.handle_mass * s.handle.v + p.tool_mass * s.tool.v; };
  EXPECT_NEAR(momentum(result.state) - momentum(start), result.wall_impulse, 1e-15);
}

TEST(OneDModel, RestStaysAtRest) {
  const ToolState rest{{0.3, 0.0}, {0.2, 0.0}};
  const StepResult result = visualStep({}, rest, {0.3, 0.0}, kStep);
  EXPECT_NEAR(result.state.handle.x, 0.3, 1e-15);
  EXPECT_NEAR(result.state.tool.x, 0.2, 1e-15);
  EXPECT_NEAR(result.coupling, 0.0, 1e-12);
}

TEST(OneDModel, ProxyTickSolvesItsEquation) {
  const Parameters p;
  const ForceModel model{-1.3, {0.2, -0.1}, -120.0, -0.8};
  const PointState proxy{0.21, -0.3}, device{0.205, -0.4};
  const double dt = 0.001;
  const PointState next = proxyTick(p, &model, proxy, device, dt);
  const double coupling =
      model.force + model.kx * (next.x - model.reference.x) + model.kv * (next.v - model.reference.v);
  EXPECT_NEAR(p.handle_mass * (next.v - proxy.v) / dt, coupling - linkForce(p, next, device), 1e-10);
  EXPECT_DOUBLE_EQ(next.x, proxy.x + dt * next.v);
}

TEST(OneDModel, DeviceVelocityAtAKnotIsTheRightHandOne) {
  const std::vector<Knot> knots{{0.0, 0.4}, {1.0, 0.2}, {2.0, 0.2}};
  EXPECT_DOUBLE_EQ(deviceAt(knots, 0.0).v, -0.2);
  EXPECT_DOUBLE_EQ(deviceAt(knots, 0.5).x, 0.3);
  EXPECT_DOUBLE_EQ(deviceAt(knots, 1.0 - 1e-8).v, -0.2);
  EXPECT_DOUBLE_EQ(deviceAt(knots, 1.0 - 5e-10).v, 0.0);
  EXPECT_DOUBLE_EQ(deviceAt(knots, 1.0).v, 0.0);
  EXPECT_DOUBLE_EQ(deviceAt(knots, 2.5).x, 0.2);
  EXPECT_DOUBLE_EQ(deviceAt(knots, 2.5).v, 0.0);
}

}  // namespace
}  // namespace palpate::one_d
