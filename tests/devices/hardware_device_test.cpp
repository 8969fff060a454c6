#include "palpate/devices/hardware_device.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "example_driver.h"
#include "palpate/common/error.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/math/rotation.h"
#include "shared/count_allocations.h"
#include "shared/haptic_models.h"

namespace {
struct Lever {
  bool there = true, answers = true;
  double position = 0, force = 0;
} lever;
}  // namespace

extern "C" {
int lever_open() { return lever.there ? 0 : -1; }
int lever_position(double* metres) {
  *metres = lever.position;
  return lever.answers ? 0 : -1;
}
int lever_force(double newtons) {
  lever.force = newtons;
  return 0;
}
}

namespace palpate {
namespace {

constexpr double kDt = 0.001;

/// A device that says what the test wants.
class FakeDriver final : public DeviceDriver {
 public:
  FakeDriver() {
    info_.name = "fake";
    info_.limits = {3.3, 0.88, 0.0, 700.0, 5.0, 1.0, 0.005, 0.1};
    info_.has_spin = true;
  }
  const DriverInfo& info() const noexcept override { return info_; }
  bool read(DriverSample& out) noexcept override {
    out = sample;
    return answers;
  }
  void write(const Vec6& wrench) noexcept override { written = wrench; }
  void release() noexcept override {
    written.setZero();
    ++released;
  }

  DriverInfo info_;
  DriverSample sample;
  bool answers = true;
  Vec6 written = Vec6::Zero();
  int released = 0;
};

class Hardware : public ::testing::Test {
 protected:
  void make(const WorkspaceSettings& settings = {}, const Pose& start = {}) {
    device = std::make_unique<HardwareDevice>(driver, settings, start);
  }
  DeviceState tick(const Vec6& wrench = Vec6::Zero()) {
    const DeviceState state = device->sample(t);
    device->apply(wrench, t, kDt);
    t = kDt * ++k;
    return state;
  }
  DeviceState ticks(int count, const Vec6& wrench = Vec6::Zero()) {
    DeviceState state;
    for (int i = 0; i < count; ++i) state = tick(wrench);
    return state;
  }
  /// In a second, so that it is a hand's motion.
  DeviceState move(const Vec3& to) {
    const Vec3 from = driver->sample.pose.position;
    DeviceState state;
    for (int i = 1; i <= 1000; ++i) {
      driver->sample.pose.position = from + i / 1000.0 * (to - from);
      state = tick();
    }
    return state;
  }

  std::shared_ptr<FakeDriver> driver = std::make_shared<FakeDriver>();
  std::unique_ptr<HardwareDevice> device;
  double t = 0;
  int k = 0;
};

Vec6 force(double x, double y, double z) {
  Vec6 out = Vec6::Zero();
  out.head<3>() = Vec3(x, y, z);
  return out;
}

TEST_F(Hardware, IsJoinedToTheHandleWhereverItIs) {
  const Pose start{Vec3(1, 2, 3), expRotation(Vec3(0.1, 0.2, 0.3))};
  driver->sample.pose = {Vec3(0.02, 0.03, -0.04), expRotation(Vec3(0, 0.5, 0))};
  make({}, start);
  const DeviceState state = tick();
  EXPECT_LT(poseDifference(state.pose, start).norm(), 1e-12);
  EXPECT_EQ(state.twist.norm(), 0.0);
}

TEST_F(Hardware, TurnsAndScalesMotionAndForce) {
  WorkspaceSettings settings;
  settings.motion_scale = 2;
  settings.force_scale = 0.5;
  settings.turn = std::numbers::pi / 2;  // its x is the world's y
  make(settings);
  ticks(1000);
  DeviceState state = move(Vec3(0.03, 0, 0.01));
  EXPECT_LT((state.pose.position - Vec3(0, 0.06, 0.02)).norm(), 1e-9);
  driver->sample.twist << 0.1, 0, 0, 1, 0, 0;
  state = tick(force(0, 2, 0));
  EXPECT_LT((state.twist - (Vec6() << 0, 0.2, 0, 0, 1, 0).finished()).norm(), 1e-12);
  EXPECT_LT((driver->written - force(1, 0, 0)).norm(), 1e-12);
}

TEST_F(Hardware, RotationsAreOneToOneInTheWorldsAxes) {
  WorkspaceSettings settings;
  settings.turn = std::numbers::pi / 2;
  driver->sample.pose.rotation = expRotation(Vec3(0.3, 0, 0.2));
  const Pose start{Vec3::Zero(), expRotation(Vec3(0, 0.4, 0))};
  make(settings, start);
  tick();
  driver->sample.pose.rotation = expRotation(Vec3(0.1, 0, 0)) * driver->sample.pose.rotation;
  const DeviceState state = tick();
  EXPECT_LT((logRotation(state.pose.rotation * start.rotation.conjugate()) - Vec3(0, 0.1, 0)).norm(), 1e-9);
}

TEST_F(Hardware, WhatTheHandFeelsIsAsStiffAsTheDeviceAllows) {
  WorkspaceSettings settings;
  settings.motion_scale = 3;
  settings.force_scale = 0.5;
  const DeviceLimits limits = worldLimits(driver->info_, settings, kDt);
  // a spring of the world's stiffness, moved by 1 mm of the device
  const double felt = settings.force_scale * limits.stiffness * settings.motion_scale * 1e-3;
  EXPECT_NEAR(felt, 0.7, 1e-12);
  EXPECT_NEAR(limits.peak_force * settings.force_scale, 3.3, 1e-12);
  EXPECT_NEAR(limits.workspace_radius, 0.3, 1e-12);
  // K T does not grow
  EXPECT_NEAR(worldLimits(driver->info_, {}, 0.004).stiffness, 175, 1e-9);
  EXPECT_NEAR(worldLimits(driver->info_, {}, 0.00025).stiffness, 700, 1e-9);
}

TEST_F(Hardware, TheClutchTakesTheHandleOffAndGivesItBackWithARamp) {
  make();
  ticks(1000);
  move(Vec3(0.02, 0, 0));
  driver->sample.buttons = 2;
  DeviceState state = ticks(150);
  EXPECT_EQ(state.force_limit, 0.0);
  state = move(Vec3(-0.05, 0, 0));
  EXPECT_LT((state.pose.position - Vec3(0.02, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(state.twist.norm(), 0.0);
  driver->sample.buttons = 0;
  state = tick();
  EXPECT_LT((state.pose.position - Vec3(0.02, 0, 0)).norm(), 1e-12);
  EXPECT_LT(state.force_limit, 0.01);
  state = move(Vec3(-0.04, 0, 0));
  EXPECT_LT((state.pose.position - Vec3(0.03, 0, 0)).norm(), 1e-12);
  EXPECT_NEAR(state.force_limit, 3.3, 1e-9);
  EXPECT_EQ(device->report().clutches, 1);
}

TEST_F(Hardware, BeyondTheBorderTheHandleGoesOn) {
  WorkspaceSettings settings;
  settings.border_speed = 0.2;
  make(settings);
  move(Vec3(0.085, 0, 0));
  EXPECT_EQ(device->report().indexed_m, 0.0);
  DeviceState state = move(Vec3(0.1, 0, 0));
  const double before = state.pose.position.x();
  state = ticks(1000);
  EXPECT_NEAR(state.pose.position.x() - before, 0.2, 1e-9);
  EXPECT_NEAR(state.twist[0], 0.2, 1e-9);
  state = move(Vec3::Zero());
  const double back = state.pose.position.x();
  EXPECT_NEAR(ticks(100).pose.position.x(), back, 1e-12);
}

TEST_F(Hardware, ADeviceThatRestsAtItsEdgeDoesNotRunAway) {
  driver->sample.pose.position = Vec3(0, -0.12, 0);
  make();
  EXPECT_EQ(ticks(1000).pose.position.norm(), 0.0);
}

TEST_F(Hardware, ALossHoldsTheHandleAndTakesTheForce) {
  make();
  ticks(1000, force(1, 0, 0));
  EXPECT_NEAR(driver->written[0], 1.0, 1e-12);
  driver->answers = false;
  DeviceState state = ticks(49, force(1, 0, 0));
  EXPECT_NEAR(state.force_limit, 3.3, 1e-9);  // a late answer is no loss
  state = ticks(200, force(1, 0, 0));
  EXPECT_EQ(state.force_limit, 0.0);
  EXPECT_EQ(driver->written.norm(), 0.0);
  driver->answers = true;
  driver->sample.pose.position = Vec3(0.05, 0.05, 0);
  state = tick(force(1, 0, 0));
  EXPECT_EQ(state.pose.position.norm(), 0.0);  // it goes on from where it is
  double last = state.force_limit, most = 0;
  for (int i = 0; i < 600; ++i) {
    state = tick();
    most = std::max(most, state.force_limit - last);
    last = state.force_limit;
  }
  EXPECT_NEAR(last, 3.3, 1e-9);
  EXPECT_LT(most, 0.007);
  EXPECT_EQ(device->report().losses, 1);
  EXPECT_NEAR(device->report().lost_s, 0.2, 0.01);
  EXPECT_EQ(device->failure(), nullptr);
}

TEST_F(Hardware, AfterItsPatienceItHasFailed) {
  WorkspaceSettings settings;
  settings.patience = 0.2;
  make(settings);
  ticks(10);
  driver->answers = false;
  ticks(190);
  EXPECT_EQ(device->failure(), nullptr);
  ticks(20);
  EXPECT_STREQ(device->failure(), "the device no longer answers");
}

TEST_F(Hardware, WhatIsNoNumberNeitherMovesNorIsSent) {
  make();
  ticks(1000);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  driver->sample.pose.position.x() = nan;
  DeviceState state = ticks(10);
  EXPECT_TRUE(state.pose.allFinite() && state.twist.allFinite() && std::isfinite(state.force_limit));
  driver->sample.pose.position.x() = 0;
  driver->sample.pose.rotation.coeffs().setZero();
  EXPECT_TRUE(tick().pose.allFinite());
  driver->sample.pose.rotation.setIdentity();
  driver->sample.twist[4] = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(tick().twist.allFinite());
  driver->sample.twist.setZero();
  state = tick(force(nan, 0, 0));
  EXPECT_EQ(driver->written.norm(), 0.0);
  EXPECT_NEAR(tick(force(1, 0, 0)).force_limit, 3.3, 1e-9);
  EXPECT_EQ(driver->written[0], 1.0);
}

TEST_F(Hardware, AJumpMovesNothing) {
  WorkspaceSettings settings;
  settings.border_speed = 0;
  for (const double far : {0.015, 0.03, 0.2}) {
    make(settings);
    ticks(1000);
    driver->sample.pose.position = Vec3(far, 0, 0);
    double least = 10;
    for (int i = 0; i < 100; ++i) {
      const DeviceState state = tick();
      ASSERT_LT(state.pose.position.norm(), 1e-12);
      least = std::min(least, state.force_limit);
    }
    EXPECT_LT(least, 0.01) << "the force does not begin anew";
    EXPECT_EQ(device->report().jumps, 1);
    driver->sample.pose.position.setZero();
  }
}

TEST_F(Hardware, AGlitchOfOneTickIsLeftOut) {
  make();
  ticks(1000);
  driver->sample.pose.position = Vec3(0.05, 0, 0);
  tick();
  driver->sample.pose.position.setZero();
  const DeviceState state = ticks(30);
  EXPECT_EQ(state.pose.position.norm(), 0.0);
  EXPECT_EQ(device->report().jumps, 0);
  EXPECT_NEAR(state.force_limit, 3.3, 1e-9);
}

TEST_F(Hardware, VelocitiesThatItDoesNotGiveAreTakenFromPoses) {
  driver->info_.has_velocity = driver->info_.has_spin = false;
  make();
  for (int i = 0; i < 200; ++i) {
    driver->sample.pose = {Vec3(1e-4 * i, 0, 0), expRotation(Vec3(0, 0, 1e-3 * i))};
    tick();
  }
  const DeviceState state = tick();
  EXPECT_NEAR(state.twist[0], 0.1, 0.02);
  EXPECT_NEAR(state.twist[5], 1.0, 0.2);
}

TEST_F(Hardware, HeldForLongTheForceComesDownToTheContinuousOne) {
  WorkspaceSettings settings;
  settings.heat_time = 2.0;
  make(settings);
  ticks(600);
  double most = 0, last = 0;
  for (int i = 0; i < 20000; ++i) {
    const DeviceState state = device->sample(t);
    last = std::min(3.3, state.force_limit);
    most = std::max(most, last);
    device->apply(force(last, 0, 0), t, kDt);
    t = kDt * ++k;
  }
  EXPECT_NEAR(most, 3.3, 1e-9);
  EXPECT_NEAR(last, 0.88, 0.005);
  EXPECT_LE(device->report().heat, 1.0);
  EXPECT_GT(device->report().hot_s, 15.0);
}

TEST_F(Hardware, NoTorqueForADeviceWithout) {
  make();
  Vec6 wrench;
  wrench << 1, 0, 0, 0.1, 0.1, 0.1;
  ticks(10, wrench);
  EXPECT_EQ(driver->written.tail<3>().norm(), 0.0);
}

TEST_F(Hardware, LetsGoAtTheEnd) {
  make();
  ticks(10, force(1, 0, 0));
  device.reset();
  EXPECT_EQ(driver->released, 1);
  EXPECT_EQ(driver->written.norm(), 0.0);
}

// All the way: the safety stage cuts to what the device gives now.
TEST_F(Hardware, TheLoopSendsNothingToADeviceThatIsLost) {
  make();
  HapticSettings settings;
  settings.rendering = Rendering::virtual_coupling;
  HapticLoop loop(settings);
  loop.start(Pose{}, Pose{}, 0.0);
  HandleModel model;
  model.handle_pose.position = Vec3(0.001, 0, 0);
  double most = 0, last = 0;
  for (int i = 0; i < 2000; ++i) {
    driver->answers = i < 1000;
    model.time = t;
    const TickRecord record = loop.tick(device->sample(t), &model, t);
    device->apply(record.sent, t, kDt);
    t = kDt * ++k;
    const double now = record.sent.head<3>().norm();
    if (i > 600) most = std::max(most, std::abs(now - last));
    last = now;
    if (i == 999) EXPECT_NEAR(driver->written[0], 0.7, 1e-6);
  }
  EXPECT_EQ(last, 0.0);
  EXPECT_EQ(driver->written.norm(), 0.0);
  EXPECT_LT(most, 0.04);  // N in a millisecond
  EXPECT_GT(loop.counters()[TickFlag::device_limited], 900u);
}

TEST_F(Hardware, ATickAllocatesNothing) {
  if (!test::kCountsMalloc) GTEST_SKIP() << "malloc belongs to a sanitizer here";
  make();
  ticks(10);
  EXPECT_EQ(test::allocationsIn([&] {
              for (int i = 0; i < 500; ++i) {
                driver->answers = i % 100 < 30;
                driver->sample.buttons = i > 300 ? 2 : 0;
                driver->sample.pose.position = Vec3(i > 400 ? 0.3 : 1e-4 * i, 0, 0);
                tick(force(1, 1, 0));
              }
            }),
            0);
}

// The example of the documents.
TEST(ExampleDriver, GivesTheLeverAllThatTheOthersHave) {
  lever = {};
  const auto driver = std::make_shared<LeverDriver>();
  {
    HardwareDevice device(driver, {}, Pose{});
    DeviceState state;
    for (int i = 0; i < 100; ++i) {
      lever.position = 1e-4 * i;
      state = device.sample(kDt * i);
      device.apply(force(0, 0.5, 0), kDt * i, kDt);
    }
    EXPECT_NEAR(state.pose.position.y(), 0.0099, 1e-9);
    EXPECT_NEAR(state.twist[1], 0.1, 0.01);
    EXPECT_NEAR(lever.force, 0.5, 1e-12);
    lever.answers = false;
    for (int i = 100; i < 300; ++i) {
      device.sample(kDt * i);
      device.apply(force(0, 0.5, 0), kDt * i, kDt);
    }
    EXPECT_EQ(lever.force, 0.0);
    EXPECT_EQ(device.report().losses, 1);
  }
  lever.there = false;
  EXPECT_THROW(LeverDriver(), RunError);
}

TEST(WorkspaceOptions, AreCheckedAndListed) {
  const WorkspaceSettings s = workspaceSettings(DeviceOptions::parse("turn=90,motion_scale=2,clutch=0"));
  EXPECT_NEAR(s.turn, std::numbers::pi / 2, 1e-12);
  EXPECT_EQ(s.motion_scale, 2.0);
  EXPECT_EQ(s.clutch, 0);
  for (const char* bad :
       {"turn=north", "motion_scale=0", "motion_scale=nan", "border=1", "heat_time=", "a", "=1", "a=1,a=2"}) {
    EXPECT_THROW(workspaceSettings(DeviceOptions::parse(bad)), InputError) << bad;
  }
  const DeviceOptions options = DeviceOptions::parse("b=2,a=1");
  EXPECT_EQ(options.string(), "a=1,b=2");
  EXPECT_EQ(DeviceOptions::parse(options.string()), options);
  EXPECT_TRUE(DeviceOptions::parse("x=yes").flag("x", false));
  EXPECT_THROW(DeviceOptions::parse("x=perhaps").flag("x", false), InputError);
}

}  // namespace
}  // namespace palpate
