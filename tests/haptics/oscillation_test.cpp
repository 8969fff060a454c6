#include "palpate/haptics/oscillation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "palpate/common/error.h"
#include "palpate/haptics/safety.h"
#include "shared/tick.h"

namespace palpate {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

Vec6 along(double x) {
  Vec6 v = Vec6::Zero();
  v[2] = x;
  return v;
}

/// A device of 45 g in a hand, in one direction.
struct Device {
  double stiffness, damping;
  double x = 0, v = 0;
  static constexpr double kMass = 0.045, kOwnDamping = 0.2;

  double step(double force, double wanted, double dt) {
    const double pull = force + stiffness * (wanted - x);
    v = (kMass * v + dt * pull) / (kMass + dt * (damping + kOwnDamping) + dt * dt * stiffness);
    x += dt * v;
    return dt * v;
  }
};

/// Drives the guard with a force and what the hand wants, both functions of time and place.
/// @return time at which a swing is found, or -1 [s]
template <typename Force, typename Wanted>
double foundAt(Device device, double dt, double until, Force&& force, Wanted&& wanted) {
  OscillationGuard guard{OscillationSettings{}};
  Vec6 sent = Vec6::Zero();
  double moved = 0;
  for (int i = 0; i * dt < until; ++i) {
    const double t = i * dt;
    if (guard.update(sent, along(moved), dt)) return t;
    sent = along(force(t, device));
    moved = device.step(sent[2], wanted(t), dt);
  }
  return -1;
}

const Device kFirm{500, 8}, kRelaxed{100, 2};

// A force that swings by itself at the device's peak, in any hand and at either rate of the loop.
TEST(Oscillation, LimitCycleIsFoundWithinFourTenths) {
  for (const double dt : {kDt, 0.25 * kDt}) {
    for (const Device& hand : {kFirm, kRelaxed}) {
      for (const double hertz : {5.0, 8.0, 13.0, 20.0, 40.0, 80.0}) {
        const auto force = [&](double t, const Device&) { return 3.3 * std::sin(kTurn * hertz * t); };
        const double found = foundAt(hand, dt, 2, force, [](double) { return 0.0; });
        EXPECT_GT(found, 0.0) << hertz << " Hz in a hand of " << hand.stiffness << " N/m";
        EXPECT_LE(found, 0.42) << hertz << " Hz in a hand of " << hand.stiffness << " N/m";
      }
    }
  }
}

// A spring that answers late is what makes such cycles: found in the hand that it swings in, and only there.
TEST(Oscillation, LateSpring) {
  for (const double late : {0.001, 0.05}) {
    std::array<double, 64> past{};
    int i = 0;
    const auto force = [&](double, const Device& device) {
      past[i % 64] = device.x;
      const int back = static_cast<int>(std::lround(late / kDt));
      const double x = past[(i + 64 - back) % 64];
      ++i;
      return std::clamp(-300 * x, -3.3, 3.3);
    };
    Device device = kRelaxed;
    device.x = 0.002;
    EXPECT_EQ(foundAt(device, kDt, 5, force, [](double) { return 0.0; }) > 0, late > 0.01);
  }
}

// Whatever the hand drives costs it energy in all.
TEST(Oscillation, TappingIsNoSwing) {
  for (const Device& hand : {kFirm, kRelaxed, Device{30, 0.5}}) {
    for (const double hertz : {1.0, 2.0, 3.0, 4.0, 5.0, 6.0}) {
      for (const double wall : {200.0, 700.0}) {
        const auto force = [&](double, const Device& d) {
          return d.x < 0 ? std::clamp(-wall * d.x - 2 * d.v, 0.0, 3.3) : 0.0;
        };
        const auto wanted = [&](double t) { return 0.005 + 0.02 * std::sin(kTurn * hertz * t); };
        EXPECT_EQ(foundAt(hand, kDt, 5, force, wanted), -1) << hertz << " Hz, wall of " << wall << " N/m";
      }
    }
  }
}

TEST(Oscillation, StickSlipIsNoSwing) {
  for (const double speed : {0.02, 0.05, 0.2}) {
    double anchor = 0;  // dry friction with a static peak, on a spring
    bool sticks = true;
    const auto force = [&](double, const Device& d) {
      double f = -600 * (d.x - anchor);
      if (sticks && std::abs(f) > 1.5) sticks = false;
      if (!sticks) {
        f = std::copysign(0.5, f);
        anchor = d.x + f / 600;
        sticks = std::abs(d.v) < 0.01;
      }
      return f;
    };
    EXPECT_EQ(foundAt(kFirm, kDt, 5, force, [&](double t) { return speed * t; }), -1) << speed;
    anchor = 0;
    sticks = true;
    EXPECT_EQ(foundAt(kRelaxed, kDt, 5, force, [&](double t) { return speed * t; }), -1) << speed;
  }
}

TEST(Oscillation, SinkingWeightIsNoSwing) {
  const auto force = [](double, const Device&) { return -2.0; };
  EXPECT_EQ(foundAt(kFirm, kDt, 5, force, [](double t) { return -0.1 * t; }), -1);
  // and a tremor of the hand on top of it
  EXPECT_EQ(foundAt(kFirm, kDt, 5, force, [](double t) { return -0.1 * t + 0.001 * std::sin(kTurn * 10 * t); }), -1);
}

// What the whole stage does about one: smoothly to zero, and back to half.
TEST(Oscillation, ForceLeavesAndComesBackSmaller) {
  SafetySettings settings;
  SafetyChain chain(settings);
  chain.start(Vec6::Zero());
  Device device = kRelaxed;
  double moved = 0, last = 0, found = -1, largest = 0, after = 0;
  int calmed = 0;
  for (int i = 0; i < 3000; ++i) {
    const double t = i * kDt;
    SafetyChain::Input in{along(2.0 * std::sin(kTurn * 8 * t)), t, 0.0, kDt, along(device.v), kDt, along(moved)};
    const auto out = chain.process(in, {});
    if (out.flags.has(TickFlag::oscillation) && found < 0) found = t;
    calmed += out.flags.has(TickFlag::calmed);
    const double swing = 2.0 * kTurn * 8 * kDt;  // what the wrench itself does in a tick
    ASSERT_LE(std::abs(out.wrench[2] - last), swing + 2.0 * kDt / 0.1 + 1e-9) << t;
    if (found > 0 && t > found + 0.11 && t < found + 0.39) largest = std::max(largest, std::abs(out.wrench[2]));
    if (found > 0 && t > found + 0.7 && t < found + 0.8) after = std::max(after, std::abs(out.wrench[2]));
    last = out.wrench[2];
    moved = device.step(last, 0, kDt);
  }
  ASSERT_GT(found, 0.0);
  EXPECT_LE(found, 0.42);
  EXPECT_EQ(largest, 0.0);
  EXPECT_GT(after, 0.5);
  EXPECT_LE(after, 1.05);
  EXPECT_EQ(calmed, 3000 - static_cast<int>(std::lround(found / kDt)));
}

TEST(Oscillation, StateGoesOnToTheBit) {
  OscillationGuard first{OscillationSettings{}}, second{OscillationSettings{}};
  for (int i = 0; i < 900; ++i) {
    const Vec6 sent = along(3 * std::sin(0.05 * i)), moved = along(1e-3 * std::sin(0.05 * i));
    if (i == 400) second.restore(first.state());
    const bool found = first.update(sent, moved, kDt);
    if (i < 400) continue;
    ASSERT_EQ(second.update(sent, moved, kDt), found);
    ASSERT_EQ(second.gain(), first.gain());
  }
  EXPECT_LT(first.gain(), 1.0);
}

TEST(Oscillation, SettingsOutOfRangeAreRejected) {
  OscillationSettings settings;
  settings.window = 0;
  EXPECT_THROW(OscillationGuard{settings}, InputError);
  settings = {};
  settings.share = 2;
  EXPECT_THROW(OscillationGuard{settings}, InputError);
}

}  // namespace
}  // namespace palpate
