#include "palpate/devices/recorded_device.h"

#include <gtest/gtest.h>

#include <sstream>

#include "palpate/common/error.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/math/rotation.h"
#include "shared/tick.h"

namespace palpate {
namespace {

HandleModel softModel() {
  HandleModel model;
  model.kx = -300.0 * Mat6::Identity();
  model.kx.bottomRightCorner<3, 3>() = -0.3 * Mat3::Identity();
  return model;
}

std::vector<TickRecord> run(Device& device, int ticks) {
  HapticLoop loop{HapticSettings{}};
  const HandleModel model = softModel();
  device.begin(loop.start(Pose{}, Pose{}, 0.0));
  std::vector<TickRecord> records;
  for (int i = 0; i < ticks; ++i) {
    records.push_back(loop.tick(device.sample(i * kDt), &model, i * kDt));
    device.apply(records.back().sent, i * kDt, kDt);
  }
  return records;
}

TEST(RecordedDevice, ReplaysToTheBit) {
  const Path path({{0.0, Vec3::Zero(), Vec3::Zero()}, {0.2, Vec3(0.01, 0.02, -0.01), Vec3(0.3, -0.4, 0.8)}},
                  Interpolation::smooth);
  SimulatedDevice moved(SimulatedDeviceSettings{}, path, Pose{});
  const std::vector<TickRecord> original = run(moved, 300);

  MotionRecording recording;
  recording.has_twist = true;
  for (const TickRecord& record : original) recording.samples.push_back({record.time, record.device});
  std::stringstream file;
  writeMotion(file, recording);
  RecordedDevice replay(parseMotion(file.str(), "motion.csv"));
  const std::vector<TickRecord> again = run(replay, 300);
  for (std::size_t i = 0; i < original.size(); ++i) {
    ASSERT_EQ(original[i].device.pose.position, again[i].device.pose.position) << i;
    ASSERT_EQ(original[i].device.pose.rotation.coeffs(), again[i].device.pose.rotation.coeffs()) << i;
    ASSERT_EQ(original[i].device.twist, again[i].device.twist) << i;
    ASSERT_EQ(original[i].sent, again[i].sent) << i;
    ASSERT_EQ(original[i].proxy.position, again[i].proxy.position) << i;
  }
  EXPECT_GT(original.back().device.pose.position.norm(), 0.01);
}

MotionRecording twoRows(bool has_twist) {
  MotionRecording recording;
  recording.has_twist = has_twist;
  recording.samples.resize(2);
  recording.samples[0].time = 1.0;
  recording.samples[1].time = 1.5;
  Vec6 xi;
  xi << 0.1, 0.0, -0.2, 0.0, 1.0, 0.0;
  recording.samples[1].state.pose = advance(Pose{}, xi);
  recording.samples[0].state.twist.setConstant(1.0);
  recording.samples[1].state.twist.setConstant(3.0);
  recording.samples[0].state.buttons = 2;
  return recording;
}

TEST(RecordedDevice, InterpolatesWithRightHandVelocities) {
  RecordedDevice device(twoRows(false));
  Vec6 velocity;
  velocity << 0.2, 0.0, -0.4, 0.0, 2.0, 0.0;
  for (const double t : {1.0 - 0.5e-9, 1.0, 1.125, 1.4}) {
    const DeviceState state = device.sample(t);
    EXPECT_LT((poseDifference(state.pose, Pose{}) - std::max(0.0, t - 1.0) * velocity).norm(), 1e-12);
    EXPECT_LT((state.twist - velocity).norm(), 1e-12);
    EXPECT_EQ(state.buttons, 2u);
  }
  EXPECT_EQ(device.sample(1.5).twist, Vec6(Vec6::Zero()));
}

TEST(RecordedDevice, UsesRecordedTwists) {
  RecordedDevice device(twoRows(true));
  EXPECT_EQ(device.sample(0.5).twist, Vec6(Vec6::Zero()));
  EXPECT_EQ(device.sample(1.0).twist, Vec6(Vec6::Constant(1.0)));
  EXPECT_LT((device.sample(1.25).twist - Vec6(Vec6::Constant(2.0))).norm(), 1e-12);
  EXPECT_EQ(device.sample(1.5).twist, Vec6(Vec6::Constant(3.0)));
  EXPECT_EQ(device.sample(2.0).twist, Vec6(Vec6::Zero()));
  EXPECT_EQ(device.sample(2.0).pose.position, twoRows(true).samples[1].state.pose.position);
  EXPECT_EQ(device.duration(), 1.5);
}

TEST(RecordedDevice, RejectsAnEmptyRecording) { EXPECT_THROW(RecordedDevice(MotionRecording{}), InputError); }

}  // namespace
}  // namespace palpate
