// A run goes on to the bit from what device and haptic loop remember.
#include "palpate/devices/device_memory.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <memory>

#include "palpate/devices/mouse_device.h"
#include "palpate/devices/prescribed_device.h"
#include "palpate/devices/recorded_device.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/math/rotation.h"
#include "shared/tick.h"

namespace palpate {
namespace {

constexpr int kBefore = 300;
constexpr int kAfter = 200;

using MakeDevice = std::function<std::unique_ptr<Device>()>;

Path stroke() {
  return Path({{0.0, Vec3::Zero(), Vec3::Zero()}, {0.8, Vec3(0.02, 0.03, -0.04), Vec3(0.5, -0.4, 0.9)}},
              Interpolation::smooth);
}

/// Each stage of the loop has something to remember at tick kBefore.
HapticSettings busySettings() {
  HapticSettings settings;
  settings.safety.passivity.enabled = true;
  settings.safety.passivity.allowance = 1e-6;
  settings.safety.start_ramp = 0.4;
  settings.safety.model_age_limit = 0.05;
  settings.safety.model_decay = 1.0;
  settings.safety.max_slew = 20.0;
  return settings;
}

/// Wall that grows old between the ticks 100 and 350; not finite in one of them.
HandleModel modelAt(int tick) {
  HandleModel model;
  model.kx = -400.0 * Mat6::Identity();
  model.kx.bottomRightCorner<3, 3>() = -0.4 * Mat3::Identity();
  model.force.x() = tick == kBefore + 3 ? std::numeric_limits<double>::quiet_NaN() : 0.3;
  model.time = tick < 100 || tick >= 350 ? tick * kDt : 100 * kDt;
  return model;
}

std::vector<TickRecord> run(Device& device, HapticLoop& loop, int first, int last) {
  std::vector<TickRecord> records;
  for (int i = first; i < last; ++i) {
    const HandleModel model = modelAt(i);
    DeviceState sample = device.sample(i * kDt);
    if (i == 10 || i == kBefore) sample.pose.position.setConstant(1e9);  // rejected: the last good one stands in
    records.push_back(loop.tick(sample, &model, i * kDt));
    device.apply(records.back().sent, i * kDt, kDt);
  }
  return records;
}

void expectSameBits(const std::vector<TickRecord>& a, const std::vector<TickRecord>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(a[i].time, b[i].time) << i;
    ASSERT_EQ(a[i].device.pose.position, b[i].device.pose.position) << i;
    ASSERT_EQ(a[i].device.pose.rotation.coeffs(), b[i].device.pose.rotation.coeffs()) << i;
    ASSERT_EQ(a[i].device.twist, b[i].device.twist) << i;
    ASSERT_EQ(a[i].proxy.position, b[i].proxy.position) << i;
    ASSERT_EQ(a[i].proxy.rotation.coeffs(), b[i].proxy.rotation.coeffs()) << i;
    ASSERT_EQ(a[i].proxy_twist, b[i].proxy_twist) << i;
    ASSERT_EQ(a[i].raw, b[i].raw) << i;
    ASSERT_EQ(a[i].sent, b[i].sent) << i;
    ASSERT_EQ(a[i].model_age, b[i].model_age) << i;
    ASSERT_EQ(a[i].delivered_energy, b[i].delivered_energy) << i;
    ASSERT_EQ(a[i].flags.bits(), b[i].flags.bits()) << i;
  }
}

void expectSameCounters(const TickCounters& a, const TickCounters& b) {
  for (std::size_t k = 0; k < kTickFlagCount; ++k)
    EXPECT_EQ(a[static_cast<TickFlag>(k)], b[static_cast<TickFlag>(k)]) << toString(static_cast<TickFlag>(k));
}

/// Goes on from tick kBefore twice: with the same device and loop, and with others built alike.
void expectGoesOnToTheBit(const MakeDevice& make) {
  const std::unique_ptr<Device> device = make();
  HapticLoop loop(busySettings());
  device->begin(loop.start(Pose{}, Pose{Vec3(0, 0, -0.001), Quat::Identity()}, 0.0));
  run(*device, loop, 0, kBefore);
  const DeviceMemory memory = device->save();
  const HapticLoopState state = loop.state();
  const std::vector<TickRecord> original = run(*device, loop, kBefore, kBefore + kAfter);
  const TickCounters counters = loop.counters();
  ASSERT_TRUE(original.front().flags.has(TickFlag::device_rejected));
  ASSERT_TRUE(original.front().flags.has(TickFlag::model_stale));
  ASSERT_TRUE(original.front().flags.has(TickFlag::ramping));
  ASSERT_TRUE(original[3].flags.has(TickFlag::model_rejected));

  device->restore(memory);
  loop.restore(state);
  EXPECT_EQ(device->save(), memory);
  expectSameBits(original, run(*device, loop, kBefore, kBefore + kAfter));
  expectSameCounters(counters, loop.counters());

  const std::unique_ptr<Device> other = make();
  HapticLoop other_loop(busySettings());
  other->restore(memory);
  other_loop.restore(state);
  expectSameBits(original, run(*other, other_loop, kBefore, kBefore + kAfter));
  expectSameCounters(counters, other_loop.counters());
}

TEST(DeviceMemory, SimulatedDeviceGoesOnToTheBit) {
  expectGoesOnToTheBit([] { return std::make_unique<SimulatedDevice>(SimulatedDeviceSettings{}, stroke(), Pose{}); });
}

TEST(DeviceMemory, MouseDeviceGoesOnToTheBitOnItsPath) {
  expectGoesOnToTheBit([] { return std::make_unique<MouseDevice>(SimulatedDeviceSettings{}, stroke(), Pose{}); });
}

TEST(DeviceMemory, PrescribedDeviceGoesOnToTheBit) {
  expectGoesOnToTheBit([] { return std::make_unique<PrescribedDevice>(stroke(), Pose{}); });
}

TEST(DeviceMemory, RecordedDeviceGoesOnToTheBit) {
  MotionRecording recording;
  for (int i = 0; i < 60; ++i)  // every 10 ms; in between the device interpolates
    recording.samples.push_back({0.01 * i, DeviceState{stroke().at(0.01 * i, Pose{}).pose, Vec6::Zero(), 0}});
  expectGoesOnToTheBit([&] { return std::make_unique<RecordedDevice>(recording); });
}

TEST(DeviceMemory, HandOfAMouseGoesOnToTheBitOnItsWay) {
  // Saved 5 ms after a command, of whose 20 ms the target still has 15 to go; what is sent later is of another time.
  MouseDevice mouse({}, stroke(), Pose{});
  const auto sendTo = [&](double x, std::uint32_t sequence) {
    HandCommand command;
    command.driver = HandCommand::Driver::hand;
    command.pose.position.x() = x;
    command.sequence = sequence;
    mouse.command(command);
  };
  const auto positions = [](Device& device, int first, int last) {
    std::vector<double> out;
    for (int i = first; i < last; ++i) {
      device.apply(0.1 * Vec6::Unit(2), i * kDt, kDt);
      out.push_back(device.sample(i * kDt).pose.position.x());
    }
    return out;
  };
  positions(mouse, 0, 100);
  sendTo(0.02, 1);
  positions(mouse, 100, 105);
  const DeviceMemory memory = mouse.save();
  const std::vector<double> original = positions(mouse, 105, 305);
  EXPECT_NEAR(original.back(), 0.02, 1e-5);

  sendTo(-0.03, 2);
  positions(mouse, 305, 400);
  sendTo(-0.05, 3);  // waits when the memory comes back
  mouse.restore(memory);
  EXPECT_EQ(mouse.taken(), 1u);
  EXPECT_EQ(positions(mouse, 105, 305), original);
  MouseDevice other({}, stroke(), Pose{});
  other.restore(memory);
  EXPECT_EQ(positions(other, 105, 305), original);
}

TEST(DeviceMemory, OfAnotherKindOfDeviceIsRefused) {
  SimulatedDevice simulated({}, stroke(), Pose{});
  MouseDevice mouse({}, stroke(), Pose{});
  PrescribedDevice prescribed(stroke(), Pose{});
  const DeviceMemory before = mouse.save();
  EXPECT_THROW(mouse.restore(simulated.save()), InputError);
  EXPECT_EQ(mouse.save(), before);
  EXPECT_THROW(simulated.restore(mouse.save()), InputError);
  EXPECT_THROW(prescribed.restore(simulated.save()), InputError);
  EXPECT_NO_THROW(prescribed.restore({}));
}

}  // namespace
}  // namespace palpate
