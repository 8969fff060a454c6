#include "palpate/haptics/realtime.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "palpate/common/error.h"

namespace palpate {
namespace {

TEST(DurationHistogram, PercentilesAreRightToAFewPercent) {
  DurationHistogram histogram;
  EXPECT_EQ(histogram.percentile(0.99), 0.0);
  for (int i = 1; i <= 100000; ++i) histogram.add(10 * i);
  EXPECT_NEAR(histogram.percentile(0.5), 500.0, 0.04 * 500.0);
  EXPECT_NEAR(histogram.percentile(0.99), 990.0, 0.04 * 990.0);
  EXPECT_EQ(histogram.percentile(1.0), 1000.0);
  EXPECT_EQ(histogram.max(), 1000.0);
  EXPECT_EQ(histogram.count(), 100000u);
}

TEST(DurationHistogram, TakesAnyValue) {
  DurationHistogram histogram;
  for (const std::int64_t value : {std::int64_t{-5}, std::int64_t{0}, std::int64_t{1}, std::int64_t{63}, INT64_MAX})
    histogram.add(value);
  EXPECT_EQ(histogram.percentile(0.2), 0.0);
  EXPECT_DOUBLE_EQ(histogram.percentile(0.8), 0.063);
  EXPECT_GT(histogram.percentile(1.0), 9e15);
}

TEST(DurationHistogram, SmallValuesAreExact) {
  for (int value = 0; value < 64; ++value) {
    DurationHistogram histogram;
    histogram.add(value);
    histogram.add(1 << 20);
    EXPECT_DOUBLE_EQ(histogram.percentile(0.5), 1e-3 * value);
  }
}

TEST(PeriodicClock, KeepsAbsoluteDeadlines) {
  PeriodicReport report;
  const std::atomic<bool> stop{false};
  const auto begin = PeriodicClock::Clock::now();
  std::int64_t last = -1;
  runPeriodic(0.002, 51, stop, report, [&](std::int64_t k, double t) {
    EXPECT_GT(k, last);
    EXPECT_EQ(t, static_cast<double>(k) * 0.002);
    EXPECT_GE(PeriodicClock::Clock::now() - begin, std::chrono::milliseconds(2 * k));
    last = k;
    return true;
  });
  EXPECT_LE(last, 50);
  // Ticks that took place and those that a busy machine made us miss are all of them.
  EXPECT_EQ(report.ticks + report.missed, 51u);
  EXPECT_EQ(report.work.count(), report.ticks);
  EXPECT_EQ(report.wake_latency.count(), report.ticks);
}

TEST(PeriodicClock, SkipsWhatALateTickMissed) {
  PeriodicReport report;
  const std::atomic<bool> stop{false};
  std::int64_t second = 0;
  runPeriodic(0.005, 1000, stop, report, [&](std::int64_t k, double) {
    if (k == 0) std::this_thread::sleep_for(std::chrono::milliseconds(23));
    if (k != 0) second = k;
    return k == 0;
  });
  EXPECT_GE(second, 4);
  EXPECT_EQ(report.missed, static_cast<std::uint64_t>(second) - 1);
}

TEST(PeriodicClock, MissesNothingBeyondTheEnd) {
  PeriodicReport report;
  const std::atomic<bool> stop{false};
  runPeriodic(0.001, 3, stop, report, [](std::int64_t, double) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return true;
  });
  EXPECT_EQ(report.ticks + report.missed, 3u);
  EXPECT_LE(report.most_missed, 3u);
  EXPECT_EQ(report.wake_latency.count(), report.ticks);
}

TEST(PeriodicClock, StopsWhenAsked) {
  PeriodicReport report;
  std::atomic<bool> stop{false};
  std::thread loop([&] { runPeriodic(0.001, 1'000'000, stop, report, [](std::int64_t, double) { return true; }); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  stop = true;
  loop.join();
  EXPECT_GT(report.ticks, 0u);
}

TEST(PeriodicClock, RejectsAPeriodThatIsNone) {
  EXPECT_THROW(PeriodicClock(0.0), InputError);
  EXPECT_THROW(PeriodicClock(-0.001), InputError);
  EXPECT_THROW(PeriodicClock(std::nan("")), InputError);
}

TEST(Realtime, SaysWhatWasGranted) {
  // In a thread of its own: the priority must not stay with the tests.
  std::thread([] {
    const RealtimeGrant grant = requestRealtime(10);
    EXPECT_EQ(grant.reason.empty(), grant.scheduled && grant.memory_locked) << grant.reason;
  }).join();
}

}  // namespace
}  // namespace palpate
