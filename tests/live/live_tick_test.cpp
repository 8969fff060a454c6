#include "palpate/live/live_tick.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/math/rotation.h"
#include "shared/live_examples.h"

namespace palpate {
namespace {

using namespace test;

LiveTickInput input() {
  LiveTickInput in;
  in.link = {700, 5, 1.0, 0.005};
  return in;
}

// Implicit Euler of a point mass on the link: exact in each tick.
TEST(LiveTick, ARigidToolIsAMassOnItsLink) {
  const LiveModel m = rigidTool(0.2);
  LiveTick tick;
  LiveState state = startState(m);
  LiveTickInput in = input();
  in.device.position = Vec3(0.02, 0, 0.01);
  Pose pose;
  Vec6 u = Vec6::Zero();
  Vec3 p = Vec3::Zero(), v = Vec3::Zero();
  for (int k = 0; k < 200; ++k) {
    u = tick.step(m, in, pose, u, state);
    pose = advance(pose, in.dt * u);
    const double a = 0.2 / in.dt + 700 * in.dt + 5;
    v = (0.2 / in.dt * v + 700 * (in.device.position - p) + 0.2 * in.gravity) / a;
    p += in.dt * v;
    ASSERT_LT((pose.position - p).norm(), 1e-14);
  }
  EXPECT_EQ(state.index, 200);
}

// One mode, which the handle does not feel.
LiveModel loneMode(double w2) {
  LiveModel m = softTool(1, 1, 0, 3);
  m.coupling.setZero();
  m.coriolis_torque[0].setZero();
  m.squared_frequency[0] = w2;
  m.damping[0] = m.beta * w2;
  return m;
}

// One mode at 8 Hz, the handle held by a stiff link: period and decay of the scheme, (1 + dt (beta + dt) w2) z'' = ...
TEST(LiveTick, AHeldModeSwingsAsTheSchemeSays) {
  const double w2 = 2500, dt = 0.001;
  const LiveModel m = loneMode(w2);
  LiveTick tick;
  LiveState state = startState(m);
  state.z[0] = 1e-3;
  double z = 1e-3, s = 0;
  const PathPoint from{0, {}, Vec6::Zero()};
  for (int k = 0; k < 500; ++k) {
    tick.replay(m, dt, Vec3::Zero(), from, {k + 1, {}, Vec6::Zero()}, state);
    s = (s / dt - w2 * z) / (1 / dt + (m.beta + dt) * w2);
    z += dt * s;
    ASSERT_NEAR(state.z[0], z, 1e-15);
  }
  // amplitude after 0.5 s: exp(-beta w2 t / 2) and the scheme's own damping of the same kind, dt w2 t / 2
  const double expected = 1e-3 * std::exp(-0.5 * (m.beta + dt) * w2 * 0.5);
  EXPECT_NEAR(std::hypot(z, s / std::sqrt(w2)), expected, 0.05 * expected);
}

// What stress takes off its stiffness or adds makes it slower or faster; at rest it gives way by the whole.
TEST(LiveTick, StressIsPartOfAModesStiffness) {
  for (const double turning : {-2000.0, 3000.0}) {
    const double w2 = 2500, dt = 0.001;
    LiveModel m = loneMode(w2);
    m.turning.resize(1, 1);
    m.turning(0, 0) = turning;
    LiveTick tick;
    LiveState state = startState(m);
    state.z[0] = 1e-3;
    double z = 1e-3, s = 0;
    PathPoint from;
    const auto go = [&](int ticks) {
      for (int k = 0; k < ticks; ++k)
        tick.replay(m, dt, Vec3::Zero(), from, {state.index + 1, {}, Vec6::Zero()}, state);
    };
    for (int k = 0; k < 300; ++k) {
      go(1);
      s = (s / dt - (w2 + turning) * z) / (1 / dt + (m.beta + dt) * w2);
      z += dt * s;
      ASSERT_NEAR(state.z[0], z, 1e-15);
    }
    const double energy = liveEnergy(m, state, {}, Vec6::Zero(), Vec3::Zero());
    EXPECT_NEAR(energy, 0.5 * s * s + 0.5 * (w2 + turning) * z * z, 1e-15);
    m.force[0] = 2.0;
    go(3000);
    EXPECT_NEAR(state.z[0], 2.0 / (w2 + turning), 1e-6);
  }
}

// Pressed by d and held: the force is d over the whole compliance, W + Qc w2^-1 Qc^T.
TEST(LiveTick, AHeldPressFeelsTheStaticCompliance) {
  const LiveModel m = softTool(4, 6, 1, 5);
  LiveTick tick;
  LiveState state = startState(m);
  PathPoint from;
  from.pose.position.z() = -0.09 - m.arm[2] - 0.002;
  PathPoint to = from;
  for (int k = 0; k < 4000; ++k) {
    to.index = k + 1;
    tick.replay(m, 0.001, Vec3::Zero(), from, to, state);
  }
  const Vec3 n = Vec3::UnitZ();
  const Mat3 c = Mat3(m.compliance) + m.shape * m.squared_frequency.cwiseInverse().asDiagonal() * m.shape.transpose();
  // the tangential force is whatever the friction stopped at; the normal displacement answers to both
  EXPECT_NEAR(n.dot(c * state.contact_force), 0.002, 2e-6);
  EXPECT_GT(state.contact_force[2], 0.1);
  EXPECT_LE(state.contact_force.head<2>().norm(), 0.5 * state.contact_force[2] * (1 + 1e-9));
}

TEST(LiveTick, ReplayGivesTheSameBitsWhereverItIsSplit) {
  LiveModel m = softTool(6, 8, 4, 7);
  for (int i = 0; i < m.contacts; ++i) m.surface[i].a.z() = m.arm[3 * i + 2] - 0.002;
  HandlePath path;
  for (int k = 0; k <= 60; ++k) {
    const double t = 0.001 * k;
    Vec6 u = Vec6::Zero();
    u << 0.1, 0, -0.3 * std::cos(30 * t), 0.5, 1, 0;
    path.add({k, {Vec3(0.1 * t, 0, -0.01 * std::sin(30 * t)), expRotation(Vec3(0.5 * t, t, 0))}, u});
  }
  LiveTick tick;
  LiveState whole = startState(m);
  ASSERT_TRUE(tick.replayTo(60, 100, m, 0.001, Vec3(0, 0, -9.81), path, whole));
  EXPECT_EQ(whole.index, 60);
  EXPECT_GT(whole.contact_force.norm(), 0.01);
  LiveState split = startState(m);
  for (const int most : {1, 4, 7, 100}) {
    LiveTick other;
    ASSERT_TRUE(other.replayTo(60, most, m, 0.001, Vec3(0, 0, -9.81), path, split));
  }
  EXPECT_EQ(split.index, 60);
  EXPECT_TRUE(split.z == whole.z && split.speed == whole.speed && split.contact_force == whole.contact_force &&
              split.damped_force == whole.damped_force);
  EXPECT_FALSE(tick.replayTo(70, 100, m, 0.001, Vec3::Zero(), path, split));  // not known so far
}

// A scene turned as a whole gives turned motion.
TEST(LiveTick, KnowsNoDirectionOfItsOwn) {
  const Quat turn = expRotation(Vec3(0.4, -0.8, 1.1));
  LiveModel m = softTool(6, 8, 4, 11), other = m;
  for (int i = 0; i < m.contacts; ++i) {
    other.surface[i].normal = turn * m.surface[i].normal;
    other.surface[i].a = turn * m.surface[i].a;
  }
  LiveTick a, b;
  LiveState sa = startState(m), sb = startState(other);
  LiveTickInput in = input(), turned_in = in;
  turned_in.gravity = turn * in.gravity;
  Pose pose, turned_pose{Vec3::Zero(), turn};
  Vec6 u = Vec6::Zero(), turned_u = u;
  for (int k = 0; k < 300; ++k) {
    in.device = {Vec3(0.02 * std::sin(0.02 * k), 0, -0.0003 * k), expRotation(Vec3(0, 0.001 * k, 0.002 * k))};
    turned_in.device = {turn * in.device.position, turn * in.device.rotation};
    u = a.step(m, in, pose, u, sa);
    turned_u = b.step(other, turned_in, turned_pose, turned_u, sb);
    pose = advance(pose, in.dt * u);
    turned_pose = advance(turned_pose, in.dt * turned_u);
    ASSERT_LT((turn * pose.position - turned_pose.position).norm(), 1e-9) << k;
    ASSERT_LT((sa.z - sb.z).norm(), 1e-9) << k;
  }
  EXPECT_GT(sa.contact_force.norm(), 0.1);
}

// Free of link, weight, contact and damping, a spinning soft tool keeps its momentum.
TEST(LiveTick, FreeFlightKeepsMomentum) {
  LiveModel m = softTool(8, 6, 0, 13);
  m.beta = 0;
  LiveTickInput in;
  in.link = {0, 0, 0, 0};
  in.gravity.setZero();
  in.dt = 1e-4;
  LiveTick tick;
  LiveState state = startState(m);
  Pose pose;
  Vec6 u;
  u << 0.1, 0.2, -0.1, 2.0, -1.0, 3.0;
  const auto momentum = [&] {
    const Mat3 r = pose.matrix();
    const Vec3 v = r.transpose() * u.head<3>(), w = r.transpose() * u.tail<3>();
    Vec3 p = m.mass * v - m.moment.cross(w) + m.coupling.topRows<3>() * state.speed;
    p += w.cross(m.coupling.topRows<3>() * state.z);
    return Vec3(r * p);
  };
  const Vec3 before = momentum();
  for (int k = 0; k < 2000; ++k) {
    u = tick.step(m, in, pose, u, state);
    pose = advance(pose, in.dt * u);
  }
  EXPECT_GT(state.z.norm(), 1e-6);
  EXPECT_LT((momentum() - before).norm(), 0.01 * before.norm());
}

// The model's one contact, of a rigid tool's place in its frame, with what is fixed.
void touchAt(const Vec3& place, LiveModel& m) {
  m.contacts = 1;
  m.arm = place;
  m.shape.resize(3, 0);
  m.compliance = 1e-7 * Mat3::Identity();
  m.tool_compliance = m.compliance;
  m.damped_force.setZero(3);
  m.contact_force.setZero(3);
  m.curvature.resize(3, 0);
}

TEST(LiveTick, DepthIsUndoneSlowly) {
  LiveModel m = rigidTool(0.2);
  touchAt(Vec3(0, 0, -0.05), m);
  LiveTick tick;
  LiveState state = startState(m);
  Pose pose;
  pose.position.z() = 0.04;  // 1 cm deep in the plane z = 0
  LiveTickInput in = input();
  in.device = pose;
  Vec6 u = Vec6::Zero();
  for (int k = 0; k < 150; ++k) {
    u = tick.step(m, in, pose, u, state);
    pose = advance(pose, in.dt * u);
    ASSERT_LE(u.head<3>().norm(), 1.05 * LiveTick::kRecoverySpeed);  // in a tick, weight and link add their own
  }
  EXPECT_NEAR(pose.position.z(), 0.05, 1e-5);
}

// A point that is pressed on a round wall, of a hole (sign -1) or a ball (1), and turns with the handle about its axis:
// the force goes with it and through the axis.
TEST(LiveTick, APointTurnsOnARoundWallWithoutTorque) {
  constexpr double kRadius = 0.014, kDepth = 5e-4, kTurn = 10 * 3.14159265358979 / 180;
  for (const double sign : {-1.0, 1.0}) {
    LiveModel m = rigidTool(0.2);
    m.contacts = 1;
    m.arm = Vec3(kRadius - sign * kDepth, 0, 0);
    m.shape.resize(3, 0);
    m.compliance = 1e-3 * Mat3::Identity();
    m.tool_compliance = m.compliance;
    m.damped_force = Vec3(sign * kDepth / 1e-3, 0, 0);
    m.contact_force = m.damped_force;
    m.curvature.resize(3, 0);
    m.arm += m.compliance * m.damped_force;  // where this force has put it
    m.surface[0].a = Vec3(kRadius, 0, 0);
    m.surface[0].normal = sign * Vec3::UnitX();
    m.surface[0].bend = sign / kRadius * (Mat3::Identity() - Vec3::UnitX() * Vec3::UnitX().transpose());
    LiveTick tick;
    LiveState state = startState(m);
    const auto at = [&](int k) {
      return PathPoint{k, {Vec3::Zero(), expRotation(Vec3(0, 0, 0.01 * k * kTurn))}, Vec6::Zero()};
    };
    for (int k = 0; k < 100; ++k) tick.replay(m, 0.001, Vec3::Zero(), at(k), at(k + 1), state);
    const Vec3 force = state.contact_force;
    EXPECT_NEAR(force.norm(), 0.5, 0.02) << sign;
    // a plane that stays gives 0.5 N r sin(10 degrees) and more
    EXPECT_LT(std::abs(Vec3(m.arm).cross(force).z()), 0.05 * 0.5 * kRadius * std::sin(kTurn)) << sign;
  }
}

// A plate on a bar across: it slides by its own half length and stays where it is, though its place of the start is
// then beside the bar. With a point alone it would sink by 15 mm.
TEST(LiveTick, AFlatFaceSlidesOverWhatIsRound) {
  LiveModel m = rigidTool(0.1);
  touchAt(Vec3(0, 0, -0.01), m);
  LiveSurface& s = m.surface[0];
  s.kind = LiveSurface::Kind::capsule;
  s.a = Vec3(0, -0.1, -0.03);
  s.b = Vec3(0, 0.1, -0.03);
  s.offset = 0.02;
  s.flat_directions = 1;
  s.flat[0] = {Vec3::UnitX(), -0.04, 0.04};
  LiveTick tick;
  LiveState state = startState(m);
  LiveTickInput in = input();
  in.link.rotational_stiffness = 1000;
  Pose pose;
  Vec6 u = Vec6::Zero();
  double lowest = 0;
  for (int k = 0; k < 200; ++k) {
    in.device.position = Vec3(1e-4 * k, 0, -0.005);
    u = tick.step(m, in, pose, u, state);
    pose = advance(pose, in.dt * u);
    lowest = std::min(lowest, pose.position.z());
  }
  EXPECT_GT(pose.position.x(), 0.019);
  EXPECT_GT(lowest, -2e-5);
  EXPECT_NEAR(state.contact_force[2], 700 * 0.005 + 0.1 * 9.81, 0.1);
}

// The model before pressed the handle into what is fixed: while it moves as recorded, a new model's contact has about
// the force that would stop the tool, not one that nothing bounds.
TEST(LiveTick, AReplayPressesARigidToolWithinBounds) {
  LiveModel m = rigidTool(0.1);
  touchAt(Vec3(0, 0, -0.05), m);
  LiveTick tick;
  LiveState state = startState(m);
  const auto at = [](int k) {
    PathPoint p;
    p.index = k;
    p.pose.position.z() = 0.05 - 2e-5 * k;
    return p;
  };
  for (int k = 0; k < 50; ++k) tick.replay(m, 0.001, Vec3::Zero(), at(k), at(k + 1), state);
  EXPECT_GT(state.contact_force[2], 1.0);
  EXPECT_LT(state.contact_force.norm(), 0.1 * 2 * LiveTick::kRecoverySpeed / 0.001);
}

TEST(HandlePath, HoldsTheLastSecond) {
  HandlePath path;
  for (int k = 5; k < 3000; ++k) path.add({k, {Vec3(k, 0, 0), Quat::Identity()}, Vec6::Zero()});
  EXPECT_EQ(path.end(), 3000);
  EXPECT_EQ(path.first(), 3000 - HandlePath::kCapacity);
  EXPECT_EQ(path[2999].pose.position.x(), 2999);
  EXPECT_FALSE(path.holds(3000));
  path.add({4000, {}, Vec6::Zero()});  // a gap: what was before is of no use
  EXPECT_EQ(path.first(), 4000);
  EXPECT_FALSE(path.holds(2999));
}

}  // namespace
}  // namespace palpate
