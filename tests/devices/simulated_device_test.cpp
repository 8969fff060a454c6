#include "palpate/devices/simulated_device.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/common/error.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/math/rotation.h"
#include "shared/tick.h"

namespace palpate {
namespace {

Pose elsewhere() {
  Vec6 xi;
  xi << 0.1, 0.2, 0.3, 0.5, -0.4, 0.2;
  return advance(Pose{}, xi);
}

Vec6 someWrench() {
  Vec6 wrench;
  wrench << 0.5, -0.2, -3.0, 0.02, 0.05, -0.01;
  return wrench;
}

TEST(SimulatedDevice, HandCarriesTheLoadOfTheStart) {
  SimulatedDevice device(SimulatedDeviceSettings{}, Path(), elsewhere());
  device.begin(someWrench());
  for (int i = 0; i < 1000; ++i) device.apply(someWrench(), i * kDt, kDt);
  const DeviceState state = device.sample(1.0);
  EXPECT_LT(poseDifference(state.pose, elsewhere()).norm(), 1e-12);
  EXPECT_LT(state.twist.norm(), 1e-10);
}

TEST(SimulatedDevice, GivesWayByItsSprings) {
  SimulatedDeviceSettings settings;
  SimulatedDevice device(settings, Path(), elsewhere());
  for (int i = 0; i < 3000; ++i) device.apply(someWrench(), i * kDt, kDt);
  const Vec6 way = poseDifference(device.sample(3.0).pose, elsewhere());
  EXPECT_LT((way.head<3>() - someWrench().head<3>() / settings.hand_stiffness).norm(), 1e-9);
  EXPECT_LT((way.tail<3>() - someWrench().tail<3>() / settings.hand_rotational_stiffness).norm(), 1e-6);
}

TEST(SimulatedDevice, OscillatesLikeADampedMassOnASpring) {
  // Position after a step of force, against the closed form as dt shrinks.
  SimulatedDeviceSettings settings;
  settings.hand_damping = 0.5;
  const double m = settings.mass, k = settings.hand_stiffness, b = settings.hand_damping + settings.damping;
  const double decay = b / (2.0 * m), omega = std::sqrt(k / m - decay * decay), t = 0.05;
  const double exact =
      1.0 / k * (1.0 - std::exp(-decay * t) * (std::cos(omega * t) + decay / omega * std::sin(omega * t)));
  const auto error = [&](int steps) {
    SimulatedDevice device(settings, Path(), Pose{});
    for (int i = 0; i < steps; ++i) device.apply(Vec6::Unit(0), i * t / steps, t / steps);
    return std::abs(device.sample(t).pose.position.x() - exact);
  };
  EXPECT_LT(error(5000), 0.002 * exact);
  EXPECT_NEAR(error(500) / error(1000), 2.0, 0.1);
}

TEST(SimulatedDevice, FollowsThePath) {
  SimulatedDeviceSettings settings;
  settings.damping = settings.rotational_damping = 0.0;
  const Path path({{0.0, Vec3::Zero(), Vec3::Zero()}, {2.0, Vec3(0.1, 0.0, 0.0), Vec3(0, 0, 1.0)}});
  SimulatedDevice device(settings, path, elsewhere());
  for (int i = 0; i < 1000; ++i) device.apply(Vec6::Zero(), i * kDt, kDt);
  const Path::Point target = path.at(1.0, elsewhere());
  EXPECT_LT(poseDifference(device.sample(1.0).pose, target.pose).norm(), 1e-6);
  EXPECT_LT((device.sample(1.0).twist - target.twist).norm(), 1e-6);
}

TEST(SimulatedDevice, StaysFiniteForAnyStep) {
  SimulatedDeviceSettings settings;
  settings.hand_stiffness = 1e6;
  settings.hand_rotational_stiffness = 1e4;
  SimulatedDevice device(settings, Path(), Pose{});
  for (int i = 0; i < 100; ++i) device.apply(someWrench(), i * 0.1, 0.1);
  EXPECT_LT(device.sample(10.0).twist.norm(), 1e-6);
}

TEST(SimulatedDevice, RestsInTheLoopFromTheFirstTick) {
  HapticSettings settings;
  HapticLoop loop(settings);
  HandleModel model;
  model.force.z() = -1.0;
  Pose proxy = elsewhere();
  proxy.position.z() -= (1.0 + settings.proxy.mass * 9.81) / settings.link.stiffness;
  SimulatedDevice device(SimulatedDeviceSettings{}, Path(), elsewhere());
  device.begin(loop.start(elsewhere(), proxy, 0.0));
  model.pose = proxy;
  model.kx = -500.0 * Mat6::Identity();
  model.kx.bottomRightCorner<3, 3>() = -0.5 * Mat3::Identity();
  for (int i = 0; i < 200; ++i) {
    const TickRecord record = loop.tick(device.sample(i * kDt), &model, i * kDt);
    device.apply(record.sent, i * kDt, kDt);
    ASSERT_LT(poseDifference(record.device.pose, elsewhere()).norm(), 1e-10);
  }
}

TEST(SimulatedDevice, HoldsAStiffContactWithoutBuzzing) {
  // Default link on the default device and hand, pressed on a wall far stiffer than the link: what moves must die out.
  HapticSettings settings;
  settings.proxy.gravity.setZero();
  HapticLoop loop(settings);
  const Path path({{0.0, Vec3::Zero(), Vec3::Zero()}, {0.5, Vec3(0, 0, -0.01), Vec3::Zero()}}, Interpolation::smooth);
  SimulatedDevice device(SimulatedDeviceSettings{}, path, Pose{});
  device.begin(loop.start(Pose{}, Pose{}, 0.0));
  HandleModel wall;
  wall.kx(2, 2) = -1e5;
  double late_motion = 0.0;
  TickRecord record;
  for (int i = 0; i < 2000; ++i) {
    wall.time = i * kDt;
    record = loop.tick(device.sample(i * kDt), &wall, i * kDt);
    device.apply(record.sent, i * kDt, kDt);
    if (i > 1500) late_motion = std::max(late_motion, record.device.twist.norm());
  }
  EXPECT_LT(late_motion, 1e-6);
  // Two springs in a row, hand and link: 10 mm shared.
  const double expected = 0.01 / (1.0 / 500.0 + 1.0 / 700.0 + 1.0 / 1e5);
  EXPECT_NEAR(record.sent[2], expected, 1e-4);
}

TEST(SimulatedDevice, RejectsBadSettings) {
  SimulatedDeviceSettings settings;
  settings.mass = 0.0;
  EXPECT_THROW(SimulatedDevice(settings, Path(), Pose{}), InputError);
  settings = {};
  settings.hand_damping = -1.0;
  EXPECT_THROW(SimulatedDevice(settings, Path(), Pose{}), InputError);
}

}  // namespace
}  // namespace palpate
