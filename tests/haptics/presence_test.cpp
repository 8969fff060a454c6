#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "palpate/haptics/haptic_loop.h"
#include "palpate/haptics/safety.h"
#include "shared/tick.h"

namespace palpate {
namespace {

/// A chain that is asked for 2 N upwards all the time.
class Held {
 public:
  explicit Held(const PresenceSettings& presence, double wanted = 2.0)
      : chain_(settingsWith(presence)), wanted_(wanted) {
    Vec6 wrench = Vec6::Zero();
    wrench[2] = wanted;
    last_ = chain_.start(wrench)[2];
  }
  /// One tick. @returns the force
  double tick() {
    SafetyChain::Input in{Vec6::Zero(), time_, 0.0, kDt, Vec6::Zero(), since_last, moved, position, buttons, good};
    in.wrench[2] = wanted_;
    in.device_twist[2] = speed;
    const auto out = chain_.process(in, {});
    flags = out.flags;
    time_ += since_last;
    since_last = kDt;
    largest_change = std::max(largest_change, std::abs(out.wrench[2] - last_));
    last_ = out.wrench[2];
    return last_;
  }
  /// Ticks until the force is `value`. @returns how many
  int until(double value, int most = 3000) {
    for (int i = 1; i <= most; ++i) {
      if (std::abs(tick() - value) < 1e-9) return i;
    }
    return -1;
  }
  double force() const { return last_; }

  double since_last = kDt;
  Vec6 moved = Vec6::Zero();
  Vec3 position = Vec3::Zero();
  std::uint32_t buttons = 0;
  bool good = true;
  double speed = 0;
  TickFlags flags;
  double largest_change = 0;  // [N]

 private:
  static SafetySettings settingsWith(const PresenceSettings& presence) {
    SafetySettings out;
    out.presence = presence;
    return out;
  }
  SafetyChain chain_;
  double wanted_, time_ = 0, last_ = 0;
};

constexpr double kOut = 0.02001;  // N in a tick of 2 N that leave in 0.1 s

TEST(Presence, NothingIsAskedByDefault) {
  Held held{PresenceSettings{}};
  held.position = Vec3(5, 0, 0);
  EXPECT_EQ(held.force(), 2.0);
  for (int i = 0; i < 2000; ++i) ASSERT_EQ(held.tick(), 2.0);
  EXPECT_EQ(held.flags.bits(), 0u);
}

TEST(Presence, DeadManButton) {
  PresenceSettings presence;
  presence.dead_man = 2;
  Held held(presence);
  EXPECT_EQ(held.force(), 0.0);
  held.buttons = 1;  // another one
  for (int i = 0; i < 500; ++i) ASSERT_EQ(held.tick(), 0.0);
  EXPECT_TRUE(held.flags.has(TickFlag::button_released));
  held.buttons = 2;
  EXPECT_NEAR(held.until(2.0), 500, 2);
  EXPECT_FALSE(held.flags.has(TickFlag::button_released));
  held.buttons = 0;
  EXPECT_NEAR(held.until(0.0), 100, 1);
  EXPECT_LE(held.largest_change, kOut);
}

TEST(Presence, WorkspaceEnds) {
  PresenceSettings presence;
  presence.workspace = 0.1;
  Held held(presence);
  held.position = Vec3(0.0999, 0, 0);
  EXPECT_EQ(held.tick(), 2.0);
  held.position = Vec3(0.1001, 0, 0);
  EXPECT_NEAR(held.until(0.0), 100, 1);
  EXPECT_TRUE(held.flags.has(TickFlag::outside_workspace));
  held.position = Vec3(0.098, 0, 0);  // not far enough back
  EXPECT_EQ(held.tick(), 0.0);
  held.position = Vec3(0.094, 0, 0);
  EXPECT_NEAR(held.until(2.0), 500, 2);
  EXPECT_LE(held.largest_change, kOut);
}

TEST(Presence, FrozenDevice) {
  PresenceSettings presence;
  presence.frozen_limit = 0.5;
  Held held(presence);
  const auto moves = [&](double by) { held.moved[0] = by; };
  for (int i = 0; i < 2000; ++i) {  // the least that a sensor shows, now and then
    moves(i % 400 == 0 ? 1e-9 : 0.0);
    ASSERT_EQ(held.tick(), 2.0) << i;
  }
  moves(0);
  EXPECT_NEAR(held.until(0.0), 202, 3);  // 399 ticks were still
  EXPECT_TRUE(held.flags.has(TickFlag::device_lost));
  for (int i = 0; i < 1000; ++i) ASSERT_EQ(held.tick(), 0.0);
  moves(1e-6);
  EXPECT_NEAR(held.until(2.0), 500, 2);
  EXPECT_LE(held.largest_change, kOut);
}

// A device that rests without a force is not frozen.
TEST(Presence, RestIsNotFrozen) {
  PresenceSettings presence;
  presence.frozen_limit = 0.5;
  Held held(presence, 0.05);
  for (int i = 0; i < 5000; ++i) ASSERT_EQ(held.tick(), 0.05);
}

TEST(Presence, LostSamples) {
  Held held{PresenceSettings{}};
  held.tick();
  held.good = false;
  EXPECT_NEAR(held.tick(), 1.98, 1e-9);
  held.good = true;
  EXPECT_NEAR(held.until(2.0), 5, 1);
  held.good = false;
  EXPECT_NEAR(held.until(0.0), 100, 1);
  EXPECT_LE(held.largest_change, kOut);
}

PresenceSettings gated() {
  PresenceSettings out;
  out.start_gate = true;
  return out;
}

/// A device of 45 g on the gate's push, in a hand or without.
struct Body {
  double stiffness, damping, x = 0, v = 0;
  void feel(Held& held) {
    v += kDt / 0.045 * (held.force() - stiffness * x - (damping + 0.2) * v);
    held.moved[2] = kDt * v;
    x += kDt * v;
    held.position.z() = x;
    held.speed = v;
  }
};

TEST(Presence, StartGateOpensInAHand) {
  for (const auto& [stiffness, damping] : {std::pair(500.0, 8.0), std::pair(100.0, 2.0), std::pair(30.0, 0.5)}) {
    Held held(gated(), 0.0);
    Body body{stiffness, damping};
    int closed = 0;
    double most = 0;
    for (int i = 0; i < 1000; ++i) {
      most = std::max(most, held.tick());
      closed += held.flags.has(TickFlag::gate_closed);
      body.feel(held);
    }
    EXPECT_NEAR(closed, 500, 3) << stiffness;
    EXPECT_NEAR(most, 0.1, 1e-3);
    EXPECT_LE(held.largest_change, 0.002);
  }
}

TEST(Presence, StartGateStaysClosedWithoutAHand) {
  Held held(gated());
  Body body{0, 0};
  double most = 0;
  for (int i = 0; i < 5000; ++i) {
    most = std::max(most, held.tick());
    ASSERT_TRUE(held.flags.has(TickFlag::gate_closed)) << i;
    body.feel(held);
  }
  EXPECT_LE(most, 0.1 + 1e-9);
}

TEST(Presence, ForceBehindTheGateComesSlowly) {
  Held held(gated());
  EXPECT_EQ(held.force(), 0.0);
  EXPECT_NEAR(held.until(2.0), 2000, 5);  // 0.3 s calm, 0.2 s push, 1.5 s ramp
  EXPECT_LE(held.largest_change, 0.003);
  held.since_last = 0.2;  // who knows what happened meanwhile
  EXPECT_EQ(held.tick(), 0.0);
  EXPECT_TRUE(held.flags.has(TickFlag::gate_closed));
}

TEST(Presence, GateWaitsForACalmDevice) {
  Held held(gated());
  held.speed = 0.3;
  for (int i = 0; i < 2000; ++i) ASSERT_EQ(held.tick(), 0.0);
  held.speed = 0.01;
  EXPECT_NEAR(held.until(2.0), 2000, 5);
}

// The device jumps by 5 cm and stays there: the force leaves from the old place, and begins from zero at the new one.
TEST(Presence, JumpOfTheDevice) {
  HapticLoop loop{HapticSettings{}};
  const Pose wall_side;
  loop.start(wall_side, wall_side, 0.0);
  HandleModel model;
  model.kx = -500.0 * Mat6::Identity();
  model.kx.bottomRightCorner<3, 3>() *= 1e-3;
  double last = 0, largest = 0, before = 0;
  int rejected = 0, zero_at = -1;
  for (int i = 0; i < 1500; ++i) {
    const double t = i * kDt;
    model.time = t;
    DeviceState device;
    device.pose.position.x() = i < 300 ? 1e-5 * i : 0.053;
    const TickRecord r = loop.tick(device, &model, t);
    rejected += r.flags.has(TickFlag::device_rejected);
    const double force = r.sent.head<3>().norm();
    if (i == 299) before = force;
    largest = std::max(largest, (i == 0 ? 0.0 : std::abs(force - last)));
    if (i >= 300 && force == 0.0 && zero_at < 0) zero_at = i - 299;
    last = force;
  }
  EXPECT_GT(before, 0.5);
  EXPECT_EQ(rejected, 100);
  EXPECT_NEAR(zero_at, 100, 1);
  EXPECT_LE(largest, 0.06);  // with what the wrench does while the proxy comes after
  EXPECT_GT(last, 2.0);      // of the new place
}

TEST(Presence, JumpForOneSampleIsLeftOut) {
  HapticLoop loop{HapticSettings{}};
  loop.start(Pose{}, Pose{}, 0.0);
  HandleModel model;
  model.kx.diagonal().head<3>().setConstant(-500.0);
  for (int i = 0; i < 400; ++i) {
    model.time = i * kDt;
    DeviceState device;
    device.pose.position.x() = i % 50 == 49 ? 0.3 : 0.001;
    const TickRecord r = loop.tick(device, &model, i * kDt);
    ASSERT_EQ(r.device.pose.position.x(), 0.001);
  }
}

}  // namespace
}  // namespace palpate
