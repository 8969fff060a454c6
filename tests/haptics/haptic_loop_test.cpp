#include "palpate/haptics/haptic_loop.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "palpate/common/error.h"
#include "shared/haptic_models.h"
#include "shared/live_examples.h"
#include "shared/tick.h"

namespace palpate {
namespace {

using test::deviceAt;
using test::randomMatrix;
using test::randomPose;
using test::randomVec6;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Model of a tool that hangs at rest, 0.2 kg in all, with a handle of the proxy's mass.
HandleModel hangingTool(const ProxySettings& proxy) {
  HandleModel model;
  model.force.z() = -(0.2 - proxy.mass) * 9.81;
  return model;
}

TEST(HapticLoop, StartsAtRestWithoutAJump) {
  HapticSettings settings;
  HapticLoop loop(settings);
  const HandleModel model = hangingTool(settings.proxy);
  Pose proxy;
  proxy.position.z() = -0.2 * 9.81 / settings.link.stiffness;
  const Vec6 start = loop.start(Pose{}, proxy, 0.0);
  EXPECT_NEAR(start[2], -0.2 * 9.81, 1e-12);
  for (int i = 0; i < 50; ++i) {
    const TickRecord record = loop.tick(DeviceState{}, &model, i * kDt);
    ASSERT_NEAR((record.raw - start).norm(), 0.0, 1e-9);
    ASSERT_EQ(record.sent, record.raw);
    ASSERT_EQ(record.flags.bits(), 0u);
    ASSERT_EQ(record.time, i * kDt);
  }
}

TEST(HapticLoop, CompensatesTheWeightAndItsMoment) {
  HapticSettings settings;
  settings.compensation.weight = Vec3(0, 0, -0.2 * 9.81);
  settings.compensation.center = Vec3(0.01, 0, 0);
  HapticLoop loop(settings);
  HandleModel model = hangingTool(settings.proxy);
  model.force[4] = 0.2 * 9.81 * 0.01;  // (0.01, 0, 0) x weight
  Pose proxy;
  proxy.position.z() = -0.2 * 9.81 / settings.link.stiffness;
  Vec6 turn = Vec6::Zero();
  turn[4] = model.force[4] / settings.link.rotational_stiffness;
  proxy = advance(proxy, turn);
  EXPECT_LT(loop.start(Pose{}, proxy, 0.0).norm(), 1e-4);  // the arm has turned a little
  const TickRecord record = loop.tick(DeviceState{}, &model, 0.0);
  EXPECT_NEAR(record.raw[2], -0.2 * 9.81, 1e-9);
  EXPECT_LT(record.sent.norm(), 1e-4);
}

TEST(HapticLoop, VirtualCouplingPullsToTheNewestVisualHandle) {
  HapticSettings settings;
  settings.rendering = Rendering::virtual_coupling;
  HapticLoop loop(settings);
  loop.start(Pose{}, Pose{}, 0.0);
  const TickRecord first = loop.tick(DeviceState{}, nullptr, 0.0);
  EXPECT_EQ(first.raw, Vec6(Vec6::Zero()));
  EXPECT_TRUE(first.flags.has(TickFlag::model_missing));

  std::mt19937 random(5);
  HandleModel model;
  model.kx = randomMatrix(random, 1e3, 0.03);  // must not matter
  model.handle_pose = randomPose(random, 0.001, 0.02);
  model.handle_twist = randomVec6(random, 0.1, 0.1);
  const DeviceState device = deviceAt(randomPose(random, 0.001, 0.02), randomVec6(random, 0.1, 0.1));
  const TickRecord record = loop.tick(device, &model, kDt);
  const Vec6 stretch = poseDifference(model.handle_pose, device.pose);
  const Vec6 rate = model.handle_twist - device.twist;
  EXPECT_LT((record.raw.head<3>() - 700.0 * stretch.head<3>() - 5.0 * rate.head<3>()).norm(), 1e-12);
  EXPECT_LT((record.raw.tail<3>() - 1.0 * stretch.tail<3>() - 0.005 * rate.tail<3>()).norm(), 1e-12);
  EXPECT_EQ(record.proxy.position, model.handle_pose.position);
}

TEST(HapticLoop, BadSamplesNeverArrive) {
  HapticSettings settings;
  HapticLoop clean(settings);
  HapticLoop dirty(settings);
  clean.start(Pose{}, Pose{}, 0.0);
  dirty.start(Pose{}, Pose{}, 0.0);
  HandleModel model;
  model.kx = -100.0 * Mat6::Identity();
  const DeviceState good = deviceAt(Pose{Vec3(0.01, 0, 0), Quat::Identity()}, Vec6::Constant(0.1));
  std::vector<DeviceState> bad(7, good);
  bad[0].pose.position.y() = kNan;
  bad[1].pose.rotation.w() = kNan;
  bad[2].twist[4] = std::numeric_limits<double>::infinity();
  bad[3].pose.rotation.coeffs().setZero();
  bad[4].pose.position.x() = 1e9;
  bad[5].twist[0] = 1e200;
  bad[6].pose.rotation.coeffs() *= 1e300;
  clean.tick(good, &model, 0.0);
  dirty.tick(good, &model, 0.0);
  for (std::size_t i = 0; i < bad.size(); ++i) {
    const double now = static_cast<double>(i + 1) * kDt;
    const TickRecord expected = clean.tick(good, &model, now);
    const TickRecord record = dirty.tick(bad[i], &model, now);
    EXPECT_TRUE(record.flags.has(TickFlag::device_rejected)) << i;
    EXPECT_EQ(record.raw, expected.raw) << i;
    // meanwhile the force leaves
    const double left = 1.0 - static_cast<double>(i + 1) * kDt / settings.safety.presence.fade;
    EXPECT_LT((record.sent - left * expected.sent).norm(), 1e-12) << i;
    EXPECT_TRUE(record.flags.has(TickFlag::device_lost)) << i;
    EXPECT_EQ(record.device.pose.position, good.pose.position) << i;
  }
  EXPECT_EQ(dirty.counters()[TickFlag::device_rejected], bad.size());
  EXPECT_EQ(clean.counters()[TickFlag::device_rejected], 0u);
}

TEST(HapticLoop, BadModelsAreIgnoredUntilTheWatchdogActs) {
  HapticSettings settings;
  HapticLoop loop(settings);
  Pose proxy;
  proxy.position.x() = 0.002;
  loop.start(Pose{}, proxy, 0.0);
  HandleModel good;
  good.force.x() = 1.4;
  good.force.z() = settings.proxy.mass * 9.81;
  HandleModel bad = good;
  bad.kx(3, 4) = kNan;
  TickRecord record;
  for (int i = 0; i < 600; ++i) {
    record = loop.tick(DeviceState{}, i == 0 ? &good : &bad, i * kDt);
    ASSERT_TRUE(record.sent.allFinite());
    if (i * kDt < settings.safety.model_age_limit) {
      ASSERT_NEAR(record.sent[0], 1.4, 1e-6);
    }
  }
  EXPECT_TRUE(record.flags.has(TickFlag::model_rejected));
  EXPECT_EQ(record.sent, Vec6(Vec6::Zero()));
  EXPECT_EQ(loop.counters()[TickFlag::model_rejected], 599u);
}

// The process is stopped for 5 s while the hand goes on: the device is 8 mm off when the ticks come back.
TEST(HapticLoop, BeginsAnewAfterAGap) {
  HapticSettings settings;
  HapticLoop loop(settings);
  loop.start(Pose{}, Pose{}, 0.0);
  HandleModel model = hangingTool(settings.proxy);
  model.kx = -200.0 * Mat6::Identity();
  const DeviceState moved = deviceAt(Pose{Vec3(0.008, 0, 0), Quat::Identity()}, Vec6::Zero());
  for (int i = 0; i < 100; ++i) loop.tick(DeviceState{}, &model, i * kDt);
  double largest = 0;
  Vec6 last = Vec6::Zero();
  for (int i = 0; i < 1000; ++i) {
    const double now = 5.0 + i * kDt;
    model.time = now;
    const TickRecord record = loop.tick(moved, &model, now);
    if (i == 0) {
      EXPECT_EQ(record.sent, Vec6(Vec6::Zero()));
    }
    largest = std::max(largest, (record.sent - last).head<3>().norm());
    last = record.sent;
  }
  EXPECT_LT(largest, 0.05);  // [N] in a tick
  EXPECT_GT(last.norm(), 0.5);
  EXPECT_EQ(loop.counters()[TickFlag::gap], 1u);
}

TEST(HapticLoop, TellsForAsLongAsAModelIsOfAnUnsoundStep) {
  HapticLoop loop(HapticSettings{});
  loop.start(Pose{}, Pose{}, 0.0);
  HandleModel sound, unsound;
  unsound.unsound = true;
  const HandleModel* const models[] = {&sound, &unsound, nullptr, nullptr, &sound};
  for (int i = 0; i < 5; ++i) {
    const TickRecord record = loop.tick(DeviceState{}, models[i], i * kDt);
    EXPECT_EQ(record.flags.has(TickFlag::model_unsound), i >= 1 && i <= 3) << i;
  }
}

TEST(HapticLoop, ViolentInputStaysWithinTheLimits) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (const Rendering rendering : {Rendering::linearized, Rendering::virtual_coupling}) {
    HapticSettings settings;
    settings.rendering = rendering;
    HapticLoop loop(settings);
    Vec6 previous = loop.start(Pose{}, Pose{}, 0.0);
    HandleModel model;
    for (int i = 0; i < 20000; ++i) {
      if (i % 33 == 0) {
        model.pose = randomPose(random, 0.1, 3.0);
        model.handle_pose = randomPose(random, 0.1, 3.0);
        model.force = randomVec6(random, 100.0, 10.0);
        model.kx = randomMatrix(random, std::pow(10.0, 12.0 * uniform(random)), 0.03);
        model.kv = randomMatrix(random, std::pow(10.0, 8.0 * uniform(random)), 0.03);
        model.time = i * kDt;
        if (uniform(random) < 0.1) model.kv(0, 1) = 1e300;
        if (uniform(random) < 0.1) model.force[2] = kNan;
      }
      DeviceState device = deviceAt(randomPose(random, 0.1, 3.0), randomVec6(random, 3.0, 30.0));
      if (uniform(random) < 0.05) device.pose.position[1] = kNan;
      const TickRecord record = loop.tick(device, &model, i * kDt);
      ASSERT_TRUE(record.sent.allFinite());
      ASSERT_TRUE(record.proxy.position.allFinite());
      ASSERT_LE(record.sent.head<3>().norm(), settings.safety.peak_force * (1 + 1e-12));
      ASSERT_LE(record.sent.tail<3>().norm(), settings.safety.peak_torque * (1 + 1e-12));
      ASSERT_LE((record.sent - previous).head<3>().norm(), settings.safety.max_slew * kDt * (1 + 1e-9));
      ASSERT_LE((record.sent - previous).tail<3>().norm(), settings.safety.max_torque_slew * kDt * (1 + 1e-9));
      previous = record.sent;
    }
  }
}

TEST(HapticLoop, SameInputGivesTheSameBits) {
  const auto run = [] {
    std::mt19937 random(7);
    HapticLoop loop{HapticSettings{}};
    loop.start(Pose{}, Pose{}, 0.0);
    HandleModel model;
    Vec6 sum = Vec6::Zero();
    for (int i = 0; i < 500; ++i) {
      model.kx = -randomMatrix(random, 100.0, 0.03);
      sum += loop.tick(deviceAt(randomPose(random, 0.01, 0.1)), &model, i * kDt).raw;
    }
    return sum;
  };
  EXPECT_EQ(run(), run());
}

/// A device of 45 g with damping b, thrown at a wall of stiffness k that the link kd renders.
/// @return kinetic energy after the rebound over that before
double rebound(double kd, double b, double k) {
  HapticSettings settings;
  settings.link = {kd, 0.0, 1.0, 0.005};
  settings.proxy.mass = 0.01;
  settings.proxy.gravity.setZero();
  settings.safety.peak_force = settings.safety.max_slew = std::numeric_limits<double>::infinity();
  settings.safety.model_age_limit = 1e9;
  HapticLoop loop(settings);
  loop.start(Pose{}, Pose{}, 0.0);
  const double mass = 0.045;
  const double speed = 0.3;
  double x = 0.0, v = -speed;
  TickRecord record;
  HandleModel model;
  for (int i = 0; i < 1000 && x <= 0.0; ++i) {
    // Wall at x = 0, felt by the proxy alone.
    model.kx(0, 0) = record.proxy.position.x() < 0.0 ? -k : 0.0;
    record = loop.tick(deviceAt(Pose{Vec3(x, 0, 0), Quat::Identity()}, v * Vec6::Unit(0)), &model, i * kDt);
    // Between ticks the device moves smoothly under the held force.
    for (int j = 0; j < 100; ++j) {
      v += kDt / 100 * (record.sent[0] - b * v) / mass;
      x += kDt / 100 * v;
    }
  }
  EXPECT_GT(x, 0.0);
  return v * v / (speed * speed);
}

TEST(HapticLoop, SampledWallTakesEnergyWithinColgatesBound) {
  // b > K T / 2 + |B|: 0.35 N s/m for 700 N/m at 1 ms.
  EXPECT_LT(rebound(700.0, 0.4, 5000.0), 1.0);
  EXPECT_LT(rebound(700.0, 0.4, 1e6), 1.0);
  // Far outside the bound the same wall throws the device back.
  EXPECT_GT(rebound(20000.0, 0.0, 1e6), 1.0);
}

TEST(PassivityObserver, CountsWhatAHeldForceDoes) {
  HapticSettings settings;
  settings.rendering = Rendering::virtual_coupling;
  settings.link.damping = 0.0;
  HapticLoop loop(settings);
  loop.start(Pose{}, Pose{}, 0.0);
  HandleModel model;
  // Slowly out to 4 mm and back: the spring's energy is put in and comes back, but for the hold of one tick, which
  // returns K T / 2 v^2 dt a tick more than it took.
  const double speed = 0.02;
  double energy = 0.0;
  TickRecord record;
  for (int i = 0; i <= 400; ++i) {
    const double x = speed * kDt * (i <= 200 ? i : 400 - i);
    model.time = i * kDt;
    record = loop.tick(deviceAt(Pose{Vec3(x, 0, 0), Quat::Identity()}), &model, i * kDt);
    if (i == 200) energy = -record.delivered_energy;
  }
  const double spring = 0.5 * 700.0 * 0.004 * 0.004;
  const double hold = 0.5 * 700.0 * kDt * speed * speed * 0.2;
  EXPECT_NEAR(energy, spring - hold, 1e-9);
  EXPECT_NEAR(record.delivered_energy, 2.0 * hold, 1e-9);
}

TEST(HapticLoop, RejectsBadSettings) {
  HapticSettings settings;
  settings.dt = 0.0;
  EXPECT_THROW(HapticLoop{settings}, InputError);
  settings = {};
  settings.link.stiffness = -1.0;
  EXPECT_THROW(HapticLoop{settings}, InputError);
  settings = {};
  settings.link.rotational_damping = kNan;
  EXPECT_THROW(HapticLoop{settings}, InputError);
}

TEST(LinkParameters, DefaultToWhatTheDeviceAllows) {
  DeviceLimits touch;
  touch.stiffness = 400.0;
  touch.damping = 4.0;
  EXPECT_EQ(linkForDevice(touch).stiffness, 400.0);
  EXPECT_EQ(linkForDevice(touch).damping, 4.0);
}

// In real time the newest model is offered at each tick. One that is too old to be replayed is refused, once, and the
// next one is taken.
TEST(HapticLoop, RefusesALiveModelOnce) {
  HapticSettings settings;
  settings.rendering = Rendering::live;
  HapticLoop loop(settings);
  loop.start(Pose{}, Pose{}, 0.0);
  LiveUpdate update{test::softTool(20, 3, 0, 3), {}};
  update.model.index = 0;
  update.state = startState(update.model);
  int tick = 0;
  const auto ticks = [&](int count, bool offered) {
    for (const int end = tick + count; tick < end; ++tick) {
      if (offered) loop.offer(update);
      loop.tick(DeviceState{}, nullptr, tick * kDt);
    }
  };
  ticks(5000, false);  // longer than the path is remembered
  ticks(100, true);
  EXPECT_EQ(loop.models().given, 1u);
  EXPECT_EQ(loop.models().refused, 1u);
  EXPECT_EQ(loop.counters()[TickFlag::model_rejected], 1u);
  update.model.index = loop.path().end() - 3;
  update.state = startState(update.model);
  ticks(100, true);
  EXPECT_EQ(loop.models().given, 2u);
  EXPECT_EQ(loop.models().used, 1u);
}

}  // namespace
}  // namespace palpate
