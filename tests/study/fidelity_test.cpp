#include "palpate/study/fidelity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

constexpr double kDt = 0.001;

Vec6 wrench(double fx, double fy, double fz, double tx = 0, double ty = 0, double tz = 0) {
  Vec6 w;
  w << fx, fy, fz, tx, ty, tz;
  return w;
}

// The device moves along x: `velocity` per tick, position its sum.
MotionTrace motionAlongX(const std::vector<double>& velocity) {
  MotionTrace out;
  double x = 0;
  for (const double v : velocity) {
    DeviceState s;
    s.pose.position.x() = x;
    s.twist[0] = v;
    out.push_back(s);
    x += v * kDt;
  }
  return out;
}

std::vector<double> constant(std::size_t n, double v) { return std::vector<double>(n, v); }

std::vector<double> joined(std::vector<double> a, const std::vector<double>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(TraceError, IsRmsAndPeakOfTheDifferenceVector) {
  const WrenchTrace reference{wrench(1, 2, 3), wrench(0, 0, 0)};
  const WrenchTrace trace{wrench(1 + 3, 2, 3 + 4, 0, 0.2, 0), wrench(0, 0, 0, 0, 0, 0)};
  const TraceError e = traceError(trace, reference);
  EXPECT_NEAR(e.rms_force, 5.0 / std::sqrt(2.0), 1e-14);
  EXPECT_NEAR(e.peak_force, 5.0, 1e-14);
  EXPECT_NEAR(e.rms_torque, 0.2 / std::sqrt(2.0), 1e-14);
  EXPECT_NEAR(e.peak_torque, 0.2, 1e-14);
  EXPECT_TRUE(e.peak_force_axes.isApprox(Vec3(3, 0, 4), 1e-14)) << e.peak_force_axes.transpose();
  const WrenchTrace turned{wrench(1, 2 - 6, 3), wrench(-1, 0, -5)};
  EXPECT_TRUE(traceError(turned, reference).peak_force_axes.isApprox(Vec3(1, 6, 5), 1e-14));
  EXPECT_EQ(traceError(reference, reference).rms_force, 0.0);
  EXPECT_THROW(traceError(trace, {wrench(0, 0, 0)}), std::logic_error);
}

TEST(FreeSegments, AreFoundAndLoseTheirSettlingPart) {
  // 0.2 s at rest, 0.5 s at 20 mm/s, 0.4 s back at 30 mm/s
  const MotionTrace motion = motionAlongX(joined(joined(constant(200, 0), constant(500, 0.02)), constant(400, -0.03)));
  std::vector<char> touching(motion.size(), 0);
  const auto segments = settledFreeSegments(motion, touching, kDt);
  ASSERT_EQ(segments.size(), 2u);
  EXPECT_EQ(segments[0].first, 350u);
  EXPECT_EQ(segments[0].last, 700u);
  EXPECT_EQ(segments[1].first, 850u);
  EXPECT_EQ(segments[1].last, 1100u);
  // one tick of contact splits the first: 200 to 399 is too short, 401 to 699 just so
  touching[400] = 1;
  const auto split = settledFreeSegments(motion, touching, kDt);
  ASSERT_EQ(split.size(), 1u);
  EXPECT_EQ(split[0].first, 850u);
  touching[400] = 0;
  touching[399] = 1;
  ASSERT_EQ(settledFreeSegments(motion, touching, kDt).size(), 2u);
  EXPECT_EQ(settledFreeSegments(motion, touching, kDt)[0].first, 550u);
}

TEST(FreeSegments, NeedConstantVelocityLengthAndSpeed) {
  const auto count = [](const std::vector<double>& velocity) {
    return settledFreeSegments(motionAlongX(velocity), std::vector<char>(velocity.size(), 0), kDt).size();
  };
  EXPECT_EQ(count(constant(299, 0.02)), 0u);
  EXPECT_EQ(count(constant(300, 0.02)), 1u);
  EXPECT_EQ(count(constant(1000, 0.004)), 0u);
  std::vector<double> slow_change, noise;
  for (int i = 0; i < 1000; ++i) {
    slow_change.push_back(0.02 * (1 + 1e-5 * i));
    noise.push_back(0.02 * (1 + 1e-7 * (i % 3)));
  }
  EXPECT_EQ(count(slow_change), 0u);
  EXPECT_EQ(count(noise), 1u);
}

TEST(Drag, IsTheSignedMeanAlongTheMotionBeyondTheReference) {
  const MotionTrace motion = motionAlongX(joined(constant(500, 0.02), constant(400, -0.04)));
  WrenchTrace reference(900, wrench(0.5, 0.1, -1)), resists = reference, alternating = reference;
  const double viscosity = 10;
  for (std::size_t i = 0; i < motion.size(); ++i) {
    resists[i][0] -= viscosity * motion[i].twist[0];
    resists[i][1] += 3;  // across the motion: no drag
    alternating[i][0] += i % 2 ? 5 : -5;
  }
  const auto segments = settledFreeSegments(motion, std::vector<char>(900, 0), kDt);
  // 350 ticks at -0.2 N, 250 ticks at -0.4 N
  ASSERT_TRUE(drag(resists, reference, motion, segments));
  EXPECT_NEAR(*drag(resists, reference, motion, segments), -(350 * 0.2 + 250 * 0.4) / 600, 1e-12);
  EXPECT_NEAR(*drag(reference, reference, motion, segments), 0, 1e-15);
  EXPECT_NEAR(*drag(alternating, reference, motion, segments), 0, 1e-12);
  EXPECT_FALSE(drag(resists, reference, motion, {}));
}

TEST(Onset, IsTheFirstContactAfterNone) {
  EXPECT_EQ(contactOnset({0, 0, 1, 1, 0, 1}), 2u);
  EXPECT_EQ(contactOnset({1, 1, 0, 0, 1}), 4u);  // starts in contact: when it comes back
  EXPECT_FALSE(contactOnset({1, 1, 0, 0}));
  EXPECT_FALSE(contactOnset({0, 0}));
  EXPECT_FALSE(contactOnset({}));
}

TEST(Onset, RiseIsRelativeToTheForceAtContact) {
  WrenchTrace trace;
  for (int i = 0; i < 200; ++i) trace.push_back(wrench(0, 0, i < 100 ? 7 : 7 - 0.01 * (i - 100)));
  ASSERT_TRUE(forceRise(trace, 100, 0.305, kDt));
  EXPECT_NEAR(*forceRise(trace, 100, 0.305, kDt), 0.031, 1e-12);
  EXPECT_NEAR(*forceRise(trace, 50, 0.305, kDt), 0.081, 1e-12);  // the same instant
  EXPECT_FALSE(forceRise(trace, 100, 2.0, kDt));
}

// Contact until tick 1000, force along z; it goes off in a straight line, `late` ticks later than that.
WrenchTrace releasedAt(std::size_t late) {
  WrenchTrace trace(1600, Vec6::Zero());
  for (std::size_t i = 0; i < trace.size(); ++i) {
    const double left = (1000.0 + static_cast<double>(late) - static_cast<double>(i)) / 500.0;
    trace[i][2] = 0.5 + std::clamp(2.0 * left, 0.0, 2.0);
  }
  return trace;
}

TEST(Release, IsTheEndOfTheLastContactBeforeFreeAir) {
  std::vector<char> touching(1600, 0);
  EXPECT_FALSE(contactRelease(touching, 0.001));
  std::fill(touching.begin() + 100, touching.begin() + 200, 1);
  std::fill(touching.begin() + 400, touching.begin() + 1000, 1);
  EXPECT_EQ(contactRelease(touching, 0.001), 1000u);
  touching[1400] = 1;  // no 0.3 s are left
  EXPECT_FALSE(contactRelease(touching, 0.001));
}

TEST(Release, OfTheForceIsWhenItStaysNearThatOfFreeAir) {
  const Vec3 free(0, 0, 0.5);
  // 0.2 N are left 50 ticks before the end of the line
  EXPECT_NEAR(*forceRelease(releasedAt(0), 1000, free, 0.2, 0.001), -0.049, 0.0011);
  EXPECT_NEAR(*forceRelease(releasedAt(90), 1000, free, 0.2, 0.001), 0.041, 0.0011);
  EXPECT_FALSE(forceRelease(releasedAt(500), 1000, free, 0.2, 0.001));
}

TEST(Release, GlueIsTheImpulseOfTheError) {
  const WrenchTrace reference = releasedAt(0);
  EXPECT_EQ(glue(reference, reference, 1000, 0.001), 0.0);
  // a triangle of 100 ms and 0.4 N
  EXPECT_NEAR(glue(releasedAt(100), reference, 1000, 0.001), 0.5 * 0.1 * 0.4, 1e-3);
}

TEST(SwitchStep, IsTheLargestAtANewModelBeyondTheReferences) {
  const WrenchTrace reference = releasedAt(0);
  WrenchTrace trace = reference;
  for (std::size_t i = 700; i < trace.size(); ++i) trace[i][0] += 0.3;
  for (std::size_t i = 800; i < trace.size(); ++i) trace[i][0] -= 0.7;
  std::vector<char> switched(trace.size(), 0);
  EXPECT_EQ(switchStep(trace, reference, switched), 0.0);
  switched[700] = 1;
  EXPECT_NEAR(switchStep(trace, reference, switched), std::hypot(0.3, 0.004) - 0.004, 1e-9);
  switched[800] = 1;
  EXPECT_NEAR(switchStep(trace, reference, switched), std::hypot(0.7, 0.004) - 0.004, 1e-9);
}

TEST(Energy, IsTheWorkOnTheHand) {
  // constant force 2 N along 0.1 m, and a torque of 0.3 Nm over half a turn in ticks
  const MotionTrace along = motionAlongX(constant(1001, 0.1));
  EXPECT_NEAR(returnedEnergy(WrenchTrace(1001, wrench(2, 0, 0)), along), 0.2, 1e-12);
  EXPECT_NEAR(returnedEnergy(WrenchTrace(1001, wrench(-2, 0, 0)), along), -0.2, 1e-12);
  MotionTrace turning(101);
  for (int i = 0; i <= 100; ++i) turning[i].pose.rotation = expRotation(Vec3(0, 0, M_PI * i / 100.0));
  EXPECT_NEAR(returnedEnergy(WrenchTrace(101, wrench(0, 0, 0, 0, 0, 0.3)), turning), 0.3 * M_PI, 1e-9);
  // a spring gives back over a closed path what it took; a damper does not
  MotionTrace there_and_back(2001);
  WrenchTrace spring(2001), damper(2001);
  const double amplitude = 0.01, rate = 2 * M_PI;
  for (int i = 0; i <= 2000; ++i) {
    const double t = i * kDt;
    there_and_back[i].pose.position.x() = amplitude * std::sin(rate * t);
    spring[i] = wrench(-100 * amplitude * std::sin(rate * (t + 0.5 * kDt)), 0, 0);
    damper[i] = wrench(-5 * amplitude * rate * std::cos(rate * t), 0, 0);
  }
  EXPECT_NEAR(returnedEnergy(spring, there_and_back), 0, 1e-9);
  EXPECT_NEAR(returnedEnergy(damper, there_and_back), -5 * amplitude * amplitude * rate * rate, 1e-4);
}

TEST(Floor, InterpolatesLinearlyAndHoldsTheLastSample) {
  const WrenchTrace samples{wrench(0, 0, 0), wrench(3, 0, 0), wrench(3, 6, 0)};
  const WrenchTrace at_ticks = interpolateSamples(samples, 0.003, 9, kDt);
  ASSERT_EQ(at_ticks.size(), 9u);
  const double x[] = {0, 1, 2, 3, 3, 3, 3, 3, 3};
  const double y[] = {0, 0, 0, 0, 2, 4, 6, 6, 6};
  for (int i = 0; i < 9; ++i) {
    EXPECT_NEAR(at_ticks[i][0], x[i], 1e-9) << i;
    EXPECT_NEAR(at_ticks[i][1], y[i], 1e-9) << i;
  }
  // a line stays a line whatever the steps, also where they do not meet the ticks
  WrenchTrace line;
  for (int k = 0; k <= 10; ++k) line.push_back(wrench(k * 0.0125, 0, 0));
  const WrenchTrace between = interpolateSamples(line, 0.0125, 100, kDt);
  for (int i = 0; i < 100; ++i) EXPECT_NEAR(between[i][0], i * kDt, 1e-12);
  EXPECT_THROW(interpolateSamples({}, 0.01, 3, kDt), std::logic_error);
}

}  // namespace
}  // namespace palpate
