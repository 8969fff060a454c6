#include "palpate/devices/mouse_device.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "palpate/math/rotation.h"
#include "shared/count_allocations.h"
#include "shared/tick.h"

namespace palpate {
namespace {

Path lineUp() {
  return Path({{0.0, Vec3::Zero(), Vec3::Zero()}, {1.0, Vec3(0, 0, 0.1), Vec3::Zero()}}, Interpolation::linear);
}

HandCommand moveTo(const Vec3& position, std::uint32_t sequence) {
  HandCommand out;
  out.driver = HandCommand::Driver::hand;
  out.pose.position = position;
  out.sequence = sequence;
  return out;
}

void run(MouseDevice& device, int& tick, int ticks) {
  for (int i = 0; i < ticks; ++i, ++tick) device.apply(Vec6::Zero(), tick * kDt, kDt);
}

TEST(MouseDevice, FollowsThePathAsASimulatedDeviceDoes) {
  MouseDevice mouse({}, lineUp(), Pose{});
  SimulatedDevice simulated({}, lineUp(), Pose{});
  for (int i = 0; i < 1500; ++i) {
    mouse.apply(Vec6::Zero(), i * kDt, kDt);
    simulated.apply(Vec6::Zero(), i * kDt, kDt);
    ASSERT_LT(poseDifference(mouse.sample(0).pose, simulated.sample(0).pose).norm(), 1e-12) << i;
  }
}

TEST(MouseDevice, GoesWhereItIsSentAndSaysWhatItTook) {
  MouseDevice mouse({}, Path(), Pose{});
  int tick = 0;
  mouse.command(moveTo(Vec3(0.03, -0.02, 0.01), 7));
  EXPECT_EQ(mouse.taken(), 0u);
  run(mouse, tick, 1000);
  EXPECT_EQ(mouse.taken(), 7u);
  EXPECT_LT((mouse.sample(1).pose.position - Vec3(0.03, -0.02, 0.01)).norm(), 1e-9);
}

TEST(MouseDevice, NeverMovesItsHandFasterThanAllowed) {
  MouseSettings limits;
  limits.max_speed = 0.5;
  limits.max_spin = 3.0;
  MouseDevice mouse({}, Path(), Pose{}, limits);
  int tick = 0;
  Pose last = mouse.handTarget();
  for (std::uint32_t n = 1; n < 200; ++n) {
    HandCommand wild = moveTo(0.4 * Vec3(std::sin(3.0 * n), std::cos(5.0 * n), std::sin(n)), n);
    wild.pose.rotation = expRotation(3.0 * Vec3(std::cos(1.0 * n), std::sin(2.0 * n), 0));
    mouse.command(wild);
    for (int i = 0; i < 16; ++i) {
      run(mouse, tick, 1);
      const Vec6 step = poseDifference(mouse.handTarget(), last);
      ASSERT_LE(step.head<3>().norm(), kDt * limits.max_speed * (1 + 1e-9));
      ASSERT_LE(step.tail<3>().norm(), kDt * limits.max_spin * (1 + 1e-6));
      last = mouse.handTarget();
    }
  }
}

TEST(MouseDevice, StaysWithinReachAndIgnoresNonsense) {
  MouseDevice mouse({}, Path(), Pose{});
  int tick = 0;
  mouse.command(moveTo(Vec3(50, 0, 0), 1));
  run(mouse, tick, 3000);
  EXPECT_NEAR(mouse.sample(3).pose.position.x(), MouseSettings{}.max_reach, 1e-6);
  HandCommand bad = moveTo(Vec3(std::numeric_limits<double>::quiet_NaN(), 0, 0), 2);
  mouse.command(bad);
  bad = moveTo(Vec3::Zero(), 3);
  bad.pose.rotation = Quat(0, 0, 0, 0);
  mouse.command(bad);
  run(mouse, tick, 10);
  EXPECT_EQ(mouse.taken(), 1u);
  EXPECT_TRUE(mouse.sample(3).pose.position.allFinite());
}

TEST(MouseDevice, PlaysItsPathAgain) {
  MouseDevice mouse({}, lineUp(), Pose{});
  int tick = 0;
  run(mouse, tick, 2000);
  mouse.command(moveTo(Vec3(0.05, 0, 0), 1));
  run(mouse, tick, 1000);
  HandCommand play;
  play.plays = 1;
  play.sequence = 1;
  mouse.command(play);
  run(mouse, tick, 500);
  EXPECT_NEAR(mouse.sample(0).pose.position.z(), 0.05, 0.01);
  run(mouse, tick, 1000);
  EXPECT_NEAR(mouse.sample(0).pose.position.z(), 0.1, 1e-6);
}

TEST(MouseDevice, TicksWithoutAllocating) {
  if (!test::kCountsMalloc) GTEST_SKIP() << "malloc belongs to a sanitizer here";
  MouseDevice mouse({}, lineUp(), Pose{});
  int tick = 0;
  mouse.command(moveTo(Vec3(0.05, 0, 0), 1));
  EXPECT_EQ(test::allocationsIn([&] { run(mouse, tick, 100); }), 0);
}

}  // namespace
}  // namespace palpate
