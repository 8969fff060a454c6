// The haptic tick must not allocate. Counts calls of malloc itself, so that it sees whatever is underneath.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <random>

#include "palpate/devices/recorded_device.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/exchange.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/haptics/realtime.h"
#include "palpate/haptics/record_queue.h"
#include "shared/count_allocations.h"
#include "shared/haptic_models.h"
#include "shared/live_examples.h"

namespace palpate {
namespace {

class Allocation : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!test::kCountsMalloc) GTEST_SKIP() << "malloc belongs to a sanitizer here";
  }
};

TEST_F(Allocation, TheCounterCounts) {
  EXPECT_GE(test::allocationsIn([] {
              void* volatile memory = std::malloc(10);
              std::free(memory);
            }),
            1);
  struct alignas(64) Wide {
    double values[8];
  };
  EXPECT_GE(test::allocationsIn([] {
              Wide* volatile wide = new Wide;
              delete wide;
            }),
            1);
}

TEST_F(Allocation, NoneInALiveTickAndItsReplay) {
  LiveModel model = test::softTool(20, LiveSize::kModes, LiveSize::kContacts, 3);
  for (int i = 0; i < model.contacts; ++i) model.surface[i].a.z() = model.arm[3 * i + 2] - 0.001;
  model.facets = 8;
  HapticSettings settings;
  settings.rendering = Rendering::live;
  HapticLoop loop(settings);
  LiveUpdate update{model, startState(model)};
  HandleModel handle;
  double most = 0;
  const int count = test::allocationsIn([&] {
    loop.start(Pose{}, Pose{}, 0.0);
    for (int i = 0; i < 500; ++i) {
      if (i % 33 == 0) {
        update.model.index = std::max(0, i - 20);  // is replayed for some ticks
        update.state = startState(update.model);
        loop.offer(update);
      }
      DeviceState device;
      device.pose.position = Vec3(1e-5 * i, 0, -2e-5 * i);
      most = std::max(most, loop.tick(device, &handle, i * 0.001).raw.norm());
    }
  });
  EXPECT_EQ(count, 0);
  EXPECT_GT(loop.counters()[TickFlag::model_catching_up], 10u);
  EXPECT_EQ(loop.counters()[TickFlag::model_rejected], 0u);
  EXPECT_GT(most, 0.5);
}

TEST_F(Allocation, NoneInATick) {
  std::mt19937 random(1);
  std::vector<HandleModel> models(50);
  for (HandleModel& model : models) {
    model.kx = test::randomMatrix(random, 1e5, 0.03);  // active: projections as well
    model.kv = test::randomMatrix(random, 1e3, 0.03);
  }
  models[7].force[0] = std::numeric_limits<double>::quiet_NaN();
  PathKey there;
  there.time = 0.5;
  there.position.x() = 0.05;
  there.rotation.y() = 1.0;
  SimulatedDevice device(SimulatedDeviceSettings{}, Path({PathKey{}, there}, Interpolation::smooth), Pose{});
  MotionRecording recording;
  for (int i = 0; i < 100; ++i) recording.samples.push_back({0.01 * i, DeviceState{}});
  RecordedDevice recorded(recording);
  HapticSettings settings;
  settings.safety.passivity.enabled = true;
  HapticLoop loop(settings);
  LatestValue<HandleModel> exchange;
  RecordQueue<TickRecord> queue(100);
  DurationHistogram times;
  const int count = test::allocationsIn([&] {
    device.begin(loop.start(Pose{}, Pose{}, 0.0));
    for (int i = 0; i < 1000; ++i) {
      if (i % 20 == 0) exchange.write(models[static_cast<std::size_t>(i / 20)]);
      const double now = i * 0.001;
      recorded.sample(now);
      const TickRecord record = loop.tick(device.sample(now), exchange.read(), now);
      device.apply(record.sent, now, 0.001);
      queue.push(record);
      times.add(i);
    }
  });
  EXPECT_EQ(count, 0);
  EXPECT_GT(loop.counters()[TickFlag::stiffness_projected], 0u);
}

}  // namespace
}  // namespace palpate
