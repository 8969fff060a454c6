#include "palpate/haptics/safety.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/common/error.h"
#include "shared/tick.h"

namespace palpate {
namespace {

constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

Vec6 wrench(double fx, double fy, double fz, double tx = 0, double ty = 0, double tz = 0) {
  Vec6 w;
  w << fx, fy, fz, tx, ty, tz;
  return w;
}

SafetyChain::Input input(const Vec6& w, double age = 0.0, double since_start = 1.0) {
  return {w, since_start, age, kDt, Vec6::Zero()};
}

SafetySettings withoutSlew() {
  SafetySettings settings;
  settings.max_slew = settings.max_torque_slew = std::numeric_limits<double>::infinity();
  return settings;
}

TEST(Safety, PassesNormalContactThroughUnchanged) {
  SafetyChain chain{SafetySettings{}};
  chain.start(Vec6::Zero());
  for (int i = 0; i < 1000; ++i) {
    const double t = i * kDt;
    // 3 N at 20 Hz changes by 380 N/s.
    const Vec6 wanted = wrench(3.0 * std::sin(125.0 * t), 0, 1, 0, 0.05 * std::sin(125.0 * t), 0);
    const auto out = chain.process(input(wanted, 0.06), {});
    ASSERT_EQ(out.wrench, wanted);
    ASSERT_EQ(out.flags.bits(), 0u);
  }
}

TEST(Safety, NotANumberBecomesZero) {
  for (const double bad :
       {kNotANumber, std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
    SafetyChain chain(withoutSlew());
    chain.start(wrench(1, 0, 0));
    const auto out = chain.process(input(wrench(1, bad, 0)), {});
    EXPECT_EQ(out.wrench, Vec6(Vec6::Zero()));
    EXPECT_TRUE(out.flags.has(TickFlag::wrench_non_finite));
    EXPECT_EQ(chain.process(input(wrench(1, 0, 0)), {}).wrench, wrench(1, 0, 0));
  }
}

TEST(Safety, ClampKeepsTheDirection) {
  SafetyChain chain(withoutSlew());
  const auto out = chain.process(input(wrench(30, 40, 0, 0, 3, 4)), {});
  EXPECT_NEAR((out.wrench.head<3>() - 3.3 * Vec3(0.6, 0.8, 0)).norm(), 0.0, 1e-12);
  EXPECT_NEAR((out.wrench.tail<3>() - 0.1 * Vec3(0, 0.6, 0.8)).norm(), 0.0, 1e-12);
  EXPECT_TRUE(out.flags.has(TickFlag::force_clamped));
  EXPECT_TRUE(out.flags.has(TickFlag::torque_clamped));
  EXPECT_NEAR(chain.process(input(wrench(1e300, 1e300, 0)), {}).wrench.norm(), 3.3, 1e-12);
}

TEST(Safety, DeviceWithoutTorqueGetsNone) {
  SafetySettings settings;
  settings.peak_torque = 0.0;
  SafetyChain chain(settings);
  EXPECT_EQ(Vec3(chain.process(input(wrench(1, 0, 0, 1, 2, 3)), {}).wrench.tail<3>()), Vec3(Vec3::Zero()));
}

TEST(Safety, SlewIsLimitedAlongTheChange) {
  SafetySettings settings;
  settings.max_slew = 100.0;
  settings.max_torque_slew = 1.0;
  SafetyChain chain(settings);
  chain.start(wrench(1, 0, 0));
  Vec6 previous = wrench(1, 0, 0);
  for (int i = 0; i < 50; ++i) {
    const auto out = chain.process(input(wrench(1, 3, 0, 0, 0, 0.05)), {});
    EXPECT_LE((out.wrench - previous).head<3>().norm(), 0.1 + 1e-12);
    EXPECT_LE((out.wrench - previous).tail<3>().norm(), 0.001 + 1e-12);
    EXPECT_DOUBLE_EQ(out.wrench[0], 1.0);
    EXPECT_EQ(out.flags.has(TickFlag::slew_limited), i < 49);
    previous = out.wrench;
  }
  EXPECT_NEAR(previous[1], 3.0, 1e-9);
  EXPECT_NEAR(previous[5], 0.05, 1e-9);
}

TEST(Safety, StaleModelLetsTheWrenchFade) {
  SafetySettings settings;
  settings.model_age_limit = modelAgeLimit(0.033, 1);
  settings.model_decay = 0.1;
  SafetyChain chain(settings);
  chain.start(wrench(2, 0, 0));
  double last = 2.0;
  double zero_at = 0.0;
  for (int i = 0; i < 500; ++i) {
    const double age = i * kDt;
    const double force = chain.process(input(wrench(2, 0, 0), age), {}).wrench[0];
    if (age <= settings.model_age_limit) {
      ASSERT_EQ(force, 2.0);
    }
    ASSERT_LE(force, last);
    if (force == 0.0 && zero_at == 0.0) zero_at = age;
    last = force;
  }
  EXPECT_NEAR(zero_at, settings.model_age_limit + settings.model_decay, 0.002);
  // A fresh model: the force fades in again, without a jump.
  EXPECT_NEAR(chain.process(input(wrench(2, 0, 0), 0.0), {}).wrench[0], 0.02, 1e-12);
  for (int i = 0; i < 100; ++i) last = chain.process(input(wrench(2, 0, 0), 0.0), {}).wrench[0];
  EXPECT_EQ(last, 2.0);
  // An age that is not a number is a stale model.
  EXPECT_LT(chain.process(input(wrench(2, 0, 0), kNotANumber), {}).wrench[0], 2.0);
}

TEST(Safety, WatchdogLeavesTheOrdinaryAgeOfAModelAlone) {
  // A visual loop that just keeps up: ages up to (latency + 1) steps.
  for (const int latency : {0, 1, 3}) EXPECT_GT(modelAgeLimit(0.033, latency), (latency + 1) * 0.033 * 1.5);
}

TEST(Safety, RampFadesIn) {
  SafetySettings settings = withoutSlew();
  settings.start_ramp = 2.0;
  SafetyChain chain(settings);
  EXPECT_EQ(chain.start(wrench(1, 0, 0)), Vec6(Vec6::Zero()));
  EXPECT_NEAR(chain.process(input(wrench(1, 0, 0), 0, 0.5), {}).wrench[0], 0.25, 1e-12);
  const auto later = chain.process(input(wrench(1, 0, 0), 0, 2.0), {});
  EXPECT_EQ(later.wrench[0], 1.0);
  EXPECT_FALSE(later.flags.has(TickFlag::ramping));
}

// Ticks did not take place for 5 s, and the wrench is another one: nothing of it at first, then a ramp.
TEST(Safety, StartsFromZeroAfterAGap) {
  SafetySettings settings;
  SafetyChain chain(settings);
  chain.start(wrench(0, 0, -0.8));
  SafetyChain::Input in = input(wrench(0, 0, -0.8));
  in.since_last = settings.gap_limit;  // a few ticks late: no gap
  EXPECT_EQ(chain.process(in, {}).wrench[2], -0.8);
  in = input(wrench(2.2, 0, 1.0));
  in.since_last = 5.0;
  auto out = chain.process(in, {});
  EXPECT_EQ(out.wrench, Vec6(Vec6::Zero()));
  EXPECT_TRUE(out.flags.has(TickFlag::gap));
  in.since_last = kDt;
  const int ramp = static_cast<int>(std::lround(settings.gap_ramp / kDt));
  for (int i = 1; i <= ramp; ++i) {
    const Vec6 last = out.wrench;
    out = chain.process(in, {});
    EXPECT_LE((out.wrench - last).norm(), 0.02) << i;
    EXPECT_FALSE(out.flags.has(TickFlag::gap));
  }
  out = chain.process(in, {});
  EXPECT_EQ(out.wrench, in.wrench);
  EXPECT_FALSE(out.flags.has(TickFlag::ramping));
}

TEST(Safety, ForceLeavesAtTheEnd) {
  SafetySettings settings;
  SafetyChain chain(settings);
  chain.start(wrench(2, 0, 0));
  chain.comeBack();  // it has not left
  EXPECT_EQ(chain.process(input(wrench(2, 0, 0)), {}).wrench[0], 2.0);
  chain.leave();
  double last = 2.0;
  int ticks = 0;
  for (; !chain.gone() && ticks < 1000; ++ticks) {
    const auto out = chain.process(input(wrench(2, 0, 0)), {});
    EXPECT_TRUE(out.flags.has(TickFlag::fading));
    EXPECT_NEAR(last - out.wrench[0], 2.0 * kDt / settings.end_fade, 1e-9);
    last = out.wrench[0];
  }
  EXPECT_EQ(last, 0.0);
  EXPECT_NEAR(ticks * kDt, settings.end_fade, 1.5 * kDt);
  chain.comeBack();
  EXPECT_EQ(chain.process(input(wrench(2, 0, 0)), {}).wrench[0], 0.0);
  EXPECT_NEAR(chain.process(input(wrench(2, 0, 0)), {}).wrench[0], 2.0 * kDt / settings.gap_ramp, 1e-9);
}

TEST(Safety, PassivityControllerTakesOutTheSurplus) {
  SafetySettings settings = withoutSlew();
  settings.passivity.enabled = true;
  settings.passivity.allowance = 0.01;
  settings.passivity.max_damping = 2.0;
  SafetyChain chain(settings);
  PassivityObserver observer;
  SafetyChain::Input moving = input(wrench(1, 0, 0));
  moving.device_twist = wrench(0.5, 0, 0);
  observer.add(wrench(1, 0, 0), wrench(0.009, 0, 0));
  EXPECT_EQ(chain.process(moving, observer).wrench[0], 1.0);
  observer.add(wrench(1, 0, 0), wrench(0.002, 0, 0));  // 1 mJ too much: 4 N s/m would take it out in a tick
  const auto damped = chain.process(moving, observer);
  EXPECT_DOUBLE_EQ(damped.wrench[0], 1.0 - 2.0 * 0.5);
  EXPECT_TRUE(damped.flags.has(TickFlag::passivity_damped));
  moving.device_twist = wrench(0.001, 0, 0);
  EXPECT_EQ(chain.process(moving, observer).wrench[0], 1.0);
}

// What force and torque take out together is the surplus, or what the dampings can.
TEST(Safety, PassivityControllerDampsTurningToo) {
  PassivitySettings settings;
  settings.enabled = true;
  settings.allowance = 0.0;
  const Vec6 twist = wrench(0.1, 0, -0.2, 3, 0, 4);
  for (const double surplus : {1e-6, 1e-5, 1.0}) {
    PassivityObserver observer;
    observer.add(wrench(surplus, 0, 0), wrench(1, 0, 0));
    const Vec6 damping = passivityWrench(settings, observer, twist, kDt);
    const double most = kDt * (settings.max_damping * 0.05 + settings.max_rotational_damping * 25);
    EXPECT_NEAR(-kDt * damping.dot(twist), std::min(surplus, most), 1e-15);
    EXPECT_LT(damping.tail<3>().dot(twist.tail<3>()), 0);
  }
  PassivityObserver observer;
  observer.add(wrench(1, 0, 0), wrench(1, 0, 0));
  const Vec6 turning = passivityWrench(settings, observer, wrench(0.001, 0, 0, 1, 0, 0), kDt);
  EXPECT_EQ(turning.head<3>(), Vec3(Vec3::Zero()));
  EXPECT_DOUBLE_EQ(turning[3], -settings.max_rotational_damping);
  EXPECT_TRUE(passivityWrench(settings, observer, wrench(0.001, 0, 0, 0.05, 0, 0), kDt).isZero(0.0));
}

// A spring that gives more on the way out than it took on the way in, turned back and forth: without the controller its
// energy grows without end.
TEST(Safety, PassivityControllerBoundsAnActiveTorsionSpring) {
  const auto delivered = [](bool enabled) {
    SafetySettings settings = withoutSlew();
    settings.passivity.enabled = enabled;
    settings.passivity.max_rotational_damping = 0.05;
    SafetyChain chain(settings);
    chain.start(Vec6::Zero());
    PassivityObserver observer;
    for (int i = 0; i < 10000; ++i) {
      const double phase = 6.0 * i * kDt, angle = 0.5 * std::sin(phase), spin = 3.0 * std::cos(phase);
      const double stiffness = angle * spin < 0 ? 0.09 : 0.07;  // [N m/rad]
      SafetyChain::Input in = input(wrench(0, 0, 0, -stiffness * angle, 0, 0));
      in.device_twist = wrench(0, 0, 0, spin, 0, 0);
      const Vec6 sent = chain.process(in, observer).wrench;
      observer.add(sent, wrench(0, 0, 0, 0.5 * (std::sin(phase + 6.0 * kDt) - std::sin(phase)), 0, 0));
    }
    return observer.delivered();
  };
  EXPECT_GT(delivered(false), 0.03);
  EXPECT_LT(delivered(true), 0.01 + 0.001);
}

TEST(Safety, RejectsBadSettings) {
  SafetySettings settings;
  settings.peak_force = -1.0;
  EXPECT_THROW(SafetyChain{settings}, InputError);
  settings = {};
  settings.start_ramp = kNotANumber;
  EXPECT_THROW(SafetyChain{settings}, InputError);
}

}  // namespace
}  // namespace palpate
