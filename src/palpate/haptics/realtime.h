#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace palpate {

/// Distribution of durations, in a fixed amount of memory: 32 buckets to an octave of nanoseconds, so a percentile is
/// right to 3 %.
class DurationHistogram {
 public:
  void add(std::int64_t nanoseconds) noexcept;
  /// Duration [us] that a share of the values, 0 to 1, does not exceed; 0 without values.
  double percentile(double share) const noexcept;
  double max() const noexcept { return 1e-3 * static_cast<double>(max_); }  ///< [us], exact
  std::uint64_t count() const noexcept { return count_; }

  struct Bin {
    double upper;  ///< [us], exclusive
    std::uint64_t count;
  };
  /// The distribution in eighths of an octave from the first value to the last; empty without values. Allocates.
  std::vector<Bin> bins() const;

 private:
  static double upperEdge(std::size_t bucket) noexcept;  // [ns]

  static constexpr int kBits = 5;
  static constexpr std::size_t kBuckets = (64 - kBits) << kBits;
  std::array<std::uint32_t, kBuckets> buckets_{};
  std::uint64_t count_ = 0;
  std::uint64_t max_ = 0;
};

/// What the system granted to a thread that asked to run in real time.
struct RealtimeGrant {
  bool scheduled = false;      ///< SCHED_FIFO
  bool memory_locked = false;  ///< mlockall
  int core = -1;               ///< that the thread stays on; -1: any
  std::string reason;          ///< why not, for people; empty when both were granted
};

/// Asks for SCHED_FIFO at `priority` (1 to 99) for the calling thread, and for the process's memory to stay in RAM.
/// Both may be refused; the thread goes on either way. A thread with that priority stays on one core, the last that the
/// process may use, if there are more: without the priority it would wait there for others. Timers of the thread are
/// not put off to save power.
RealtimeGrant requestRealtime(int priority);

/// While it lives, no core sleeps so deeply that waking up takes long, if the system grants it.
class AwakeCores {
 public:
  AwakeCores() noexcept;
  ~AwakeCores();
  AwakeCores(const AwakeCores&) = delete;
  AwakeCores& operator=(const AwakeCores&) = delete;
  bool granted() const noexcept { return file_ >= 0; }

 private:
  int file_;
};

/// Timing of a periodic thread.
struct PeriodicReport {
  DurationHistogram wake_latency;  ///< deadline to wake-up
  DurationHistogram work;          ///< time that the work took
  std::uint64_t ticks = 0;
  std::uint64_t missed = 0;       ///< deadlines that went by while a tick was late; their ticks did not take place
  std::uint64_t most_missed = 0;  ///< in a row
};

/// Deadlines start + k * period on the monotonic clock, multiplied and never accumulated. A tick that is late by whole
/// periods skips the deadlines that have gone by: the loop catches up at once instead of hurrying after its past.
class PeriodicClock {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param period  [s], at least 10 us. @throws InputError
  explicit PeriodicClock(double period);

  /// First deadline; several loops share one origin by starting at the same instant.
  /// @param end  number of the first deadline that is no part of the run: neither it nor a later one is reported
  void start(Clock::time_point first = Clock::now(),
             std::int64_t end = std::numeric_limits<std::int64_t>::max()) noexcept;
  /// Sleeps until the next deadline. @return its number k; deadlines skipped since the last call are missed
  std::int64_t wait(PeriodicReport& report) noexcept;
  /// For a thread that somebody else wakes, about as often: number of its tick, or -1 for a call that is one too many.
  /// Up to three ticks early or late are taken as they come; more behind are missed.
  std::int64_t follow(PeriodicReport& report) noexcept;
  /// Deadline of tick k [s] since start(): k * period.
  double time(std::int64_t k) const noexcept;
  /// [s] since start().
  double elapsed() const noexcept;

 private:
  void skip(std::int64_t deadlines, PeriodicReport& report) noexcept;
  std::int64_t wake(Clock::time_point now, PeriodicReport& report) noexcept;

  std::chrono::nanoseconds period_;
  Clock::time_point start_;
  std::int64_t next_ = 0, end_ = std::numeric_limits<std::int64_t>::max();
};

/// Calls work(k, k * period) at each deadline until `stop` is set, work returns false or there are no more.
/// @param deadlines  how many there are: k < deadlines
/// @param report  filled while it runs; read it after the return
template <typename Work>
void runPeriodic(double period, std::int64_t deadlines, const std::atomic<bool>& stop, PeriodicReport& report,
                 Work&& work) {
  PeriodicClock clock(period);
  clock.start(PeriodicClock::Clock::now(), deadlines);
  bool more = true;
  while (more && !stop.load(std::memory_order_relaxed)) {
    const std::int64_t k = clock.wait(report);
    if (k >= deadlines) break;
    const auto begin = PeriodicClock::Clock::now();
    more = work(k, static_cast<double>(k) * period);
    report.work.add(std::chrono::nanoseconds(PeriodicClock::Clock::now() - begin).count());
    ++report.ticks;
  }
}

}  // namespace palpate
