#include "palpate/haptics/realtime.h"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>

#include "palpate/common/error.h"

namespace palpate {

void DurationHistogram::add(std::int64_t nanoseconds) noexcept {
  const auto value = static_cast<std::uint64_t>(std::max<std::int64_t>(nanoseconds, 0));
  const int shift = std::max(0, static_cast<int>(std::bit_width(value)) - kBits - 1);
  // Below 2^(kBits + 1) a bucket a value; above, the top kBits + 1 bits say which.
  const std::size_t bucket = (static_cast<std::size_t>(shift) << kBits) + static_cast<std::size_t>(value >> shift);
  ++buckets_[std::min(bucket, kBuckets - 1)];
  ++count_;
  max_ = std::max(max_, value);
}

double DurationHistogram::percentile(double share) const noexcept {
  const double wanted = share * static_cast<double>(count_);
  double seen = 0.0;
  for (std::size_t bucket = 0; bucket < kBuckets && count_ > 0; ++bucket) {
    seen += static_cast<double>(buckets_[bucket]);
    if (buckets_[bucket] == 0 || seen < wanted) continue;
    return 1e-3 * std::min(upperEdge(bucket) - 1.0, static_cast<double>(max_));
  }
  return max();
}

double DurationHistogram::upperEdge(std::size_t bucket) noexcept {
  const std::size_t octave = bucket >> kBits;
  const std::size_t shift = octave > 1 ? octave - 1 : 0;
  return static_cast<double>(((bucket - (shift << kBits)) + 1) << shift);
}

std::vector<DurationHistogram::Bin> DurationHistogram::bins() const {
  constexpr std::size_t kJoined = (std::size_t{1} << kBits) / 8;
  std::vector<Bin> out;
  for (std::size_t first = 0; first < kBuckets; first += kJoined) {
    std::uint64_t sum = 0;
    for (std::size_t k = 0; k < kJoined; ++k) sum += buckets_[first + k];
    if (sum > 0 || !out.empty()) out.push_back({1e-3 * upperEdge(first + kJoined - 1), sum});
  }
  while (!out.empty() && out.back().count == 0) out.pop_back();
  return out;
}

namespace {

// @returns the core, or -1 if there is only one, or none is granted
int stayOnOneCore() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (sched_getaffinity(0, sizeof allowed, &allowed) != 0 || CPU_COUNT(&allowed) < 2) return -1;
  int core = CPU_SETSIZE - 1;
  while (!CPU_ISSET(core, &allowed)) --core;
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(core, &one);
  return sched_setaffinity(0, sizeof one, &one) == 0 ? core : -1;
}

}  // namespace

AwakeCores::AwakeCores() noexcept : file_(open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC)) {
  const std::int32_t none = 0;  // [us] that waking up may take, for as long as the file is open
  if (file_ >= 0 && write(file_, &none, sizeof none) != static_cast<ssize_t>(sizeof none)) {
    close(file_);
    file_ = -1;
  }
}

AwakeCores::~AwakeCores() {
  if (file_ >= 0) close(file_);
}

RealtimeGrant requestRealtime(int priority) {
  RealtimeGrant grant;
  sched_param parameters{};
  parameters.sched_priority = std::clamp(priority, 1, 99);
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  grant.scheduled = error == 0;
  if (error != 0) grant.reason = std::string("SCHED_FIFO refused: ") + std::strerror(error);
  if (grant.scheduled) grant.core = stayOnOneCore();
  prctl(PR_SET_TIMERSLACK, 1UL);  // [ns]; threads of real-time priority have none
  // Pages are locked when they are first touched, or every thread's whole stack would be taken. Where the amount is
  // limited, later memory stays unlocked: beyond the limit it would be refused.
  rlimit limit{};
  const bool unlimited = geteuid() == 0 || (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY);
  grant.memory_locked = mlockall(MCL_CURRENT | MCL_ONFAULT | (unlimited ? MCL_FUTURE : 0)) == 0;
  if (!grant.memory_locked) {
    const std::string why = std::string("mlockall refused: ") + std::strerror(errno);
    grant.reason += (grant.reason.empty() ? "" : "; ") + why;
  }
  return grant;
}

PeriodicClock::PeriodicClock(double period) {
  if (!(period >= 1e-5) || !(period <= 3600.0)) throw InputError("period", "", "must be 10 us to one hour");
  period_ = std::chrono::nanoseconds(std::llround(period * 1e9));
}

void PeriodicClock::start(Clock::time_point first, std::int64_t end) noexcept {
  start_ = first;
  next_ = 0;
  end_ = end;
}

void PeriodicClock::skip(std::int64_t deadlines, PeriodicReport& report) noexcept {
  const auto missed = static_cast<std::uint64_t>(std::clamp<std::int64_t>(end_ - next_, 0, deadlines));
  report.missed += missed;
  report.most_missed = std::max(report.most_missed, missed);
  next_ += deadlines;
}

std::int64_t PeriodicClock::wake(Clock::time_point now, PeriodicReport& report) noexcept {
  if (next_ < end_) report.wake_latency.add(std::chrono::nanoseconds(now - (start_ + next_ * period_)).count());
  return next_++;
}

std::int64_t PeriodicClock::wait(PeriodicReport& report) noexcept {
  const std::chrono::nanoseconds late = Clock::now() - (start_ + next_ * period_);
  if (late >= period_) skip(late / period_, report);
  const Clock::time_point deadline = start_ + next_ * period_;
  const auto since_epoch = std::chrono::nanoseconds(deadline.time_since_epoch()).count();
  timespec until{};
  until.tv_sec = static_cast<time_t>(since_epoch / 1'000'000'000);
  until.tv_nsec = static_cast<long>(since_epoch % 1'000'000'000);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
  return wake(Clock::now(), report);
}

std::int64_t PeriodicClock::follow(PeriodicReport& report) noexcept {
  constexpr std::int64_t kSlack = 3;
  const Clock::time_point now = Clock::now();
  const std::chrono::nanoseconds elapsed = now - start_;
  if (elapsed < next_ * period_ - kSlack * period_) return -1;
  const std::int64_t behind = elapsed / period_ - next_;
  if (behind > kSlack) skip(behind, report);
  return wake(now, report);
}

double PeriodicClock::time(std::int64_t k) const noexcept { return std::chrono::duration<double>(k * period_).count(); }

double PeriodicClock::elapsed() const noexcept { return std::chrono::duration<double>(Clock::now() - start_).count(); }

}  // namespace palpate
