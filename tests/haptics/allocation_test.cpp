// The haptic tick must not allocate. Counts calls of malloc itself, so that it sees whatever is underneath.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <limits>
#include <random>

#include "palpate/devices/recorded_device.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/exchange.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/haptics/realtime.h"
#include "palpate/haptics/record_queue.h"
#include "test_models.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(__GLIBC__)
#define PALPATE_COUNTS_MALLOC 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define PALPATE_COUNTS_MALLOC 0
#endif
#endif
#ifndef PALPATE_COUNTS_MALLOC
#define PALPATE_COUNTS_MALLOC 1
#endif

namespace {
std::atomic<bool> counting{false};
std::atomic<int> allocations{0};

[[maybe_unused]] void count() {
  if (counting.load(std::memory_order_relaxed)) allocations.fetch_add(1, std::memory_order_relaxed);
}
}  // namespace

#if PALPATE_COUNTS_MALLOC
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  count();
  return __libc_malloc(size);
}
void* calloc(std::size_t number, std::size_t size) {
  count();
  return __libc_calloc(number, size);
}
void* realloc(void* memory, std::size_t size) {
  count();
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  count();
  return __libc_memalign(alignment, size);
}
}
#endif

namespace palpate {
namespace {

int allocationsIn(const auto& work) {
  allocations = 0;
  counting = true;
  work();
  counting = false;
  return allocations;
}

class Allocation : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!PALPATE_COUNTS_MALLOC) GTEST_SKIP() << "malloc belongs to a sanitizer here";
  }
};

TEST_F(Allocation, TheCounterCounts) {
  EXPECT_GE(allocationsIn([] {
              void* volatile memory = std::malloc(10);
              std::free(memory);
            }),
            1);
  struct alignas(64) Wide {
    double values[8];
  };
  EXPECT_GE(allocationsIn([] {
              Wide* volatile wide = new Wide;
              delete wide;
            }),
            1);
}

TEST_F(Allocation, NoneInATick) {
  std::mt19937 random(1);
  std::vector<HandleModel> models(50);
  for (HandleModel& model : models) {
    model.kx = testing::randomMatrix(random, 1e5, 0.03);  // active: projections as well
    model.kv = testing::randomMatrix(random, 1e3, 0.03);
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
  const int count = allocationsIn([&] {
    device.startInEquilibrium(loop.start(Pose{}, Pose{}, 0.0));
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
