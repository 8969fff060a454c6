#include "palpate/threads/thread_team.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "palpate/common/error.h"

namespace palpate {
namespace {

constexpr int kPartBits = 16;
constexpr std::uint64_t kPartMask = (std::uint64_t{1} << kPartBits) - 1;
constexpr std::chrono::microseconds kLookout{1000};

std::uint64_t nextOf(std::uint64_t ticket) { return ticket & kPartMask; }
std::uint64_t partsOf(std::uint64_t ticket) { return ticket >> kPartBits & kPartMask; }
std::uint64_t numberOf(std::uint64_t ticket) { return ticket >> 2 * kPartBits; }
std::uint64_t makeTicket(std::uint64_t number, int parts) {
  return number << 2 * kPartBits | static_cast<std::uint64_t>(parts) << kPartBits;
}

void relax() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

// Of a thread that waits for one that may not be running, for want of a core.
void pass(unsigned& pauses) {
  relax();
  if (++pauses % 1024 == 0) std::this_thread::yield();
}

}  // namespace

ThreadTeam::ThreadTeam(int threads) {
  const int others = std::clamp(threads, 1, kMaxThreads) - 1;
  workers_.reserve(static_cast<std::size_t>(others));
  for (int i = 0; i < others; ++i) workers_.emplace_back([this] { work(); });
}

ThreadTeam::~ThreadTeam() {
  stop_.store(true);
  wake();
  for (std::thread& worker : workers_) worker.join();
}

int ThreadTeam::suitable() {
  const int cores = static_cast<int>(std::thread::hardware_concurrency());
  return std::clamp(cores > 2 ? cores - 1 : cores, 1, 4);
}

// Takes the next part of the ticket's loop, if it has one and is still the present one; brings the ticket up to date.
bool ThreadTeam::Loops::takePart(std::uint64_t& ticket) noexcept {
  while (nextOf(ticket) < partsOf(ticket)) {
    if (ticket_.compare_exchange_weak(ticket, ticket + 1, std::memory_order_acq_rel, std::memory_order_acquire)) {
      return true;
    }
  }
  return false;
}

void ThreadTeam::Loops::finish(int i) noexcept {
  try {
    part_(loop_, i);
  } catch (...) {
    if (!failed_.exchange(true)) failure_ = std::current_exception();
  }
  done_.fetch_add(1, std::memory_order_release);
}

bool ThreadTeam::Loops::help() noexcept {
  bool any = false;
  std::uint64_t ticket = ticket_.load(std::memory_order_acquire);
  while (takePart(ticket)) {
    any = true;
    finish(static_cast<int>(nextOf(ticket)));
    ticket = ticket_.load(std::memory_order_acquire);
  }
  return any;
}

void ThreadTeam::Loops::run(int parts, void (*part)(void* loop, int i), void* loop) {
  if (parts > kMaxParts) throw RunError("a loop of " + std::to_string(parts) + " parts: too many");
  part_ = part;
  loop_ = loop;
  done_.store(0, std::memory_order_relaxed);
  const std::uint64_t number = numberOf(ticket_.load(std::memory_order_relaxed)) + 1;
  ticket_.store(makeTicket(number, parts), std::memory_order_release);
  team_.wake();
  help();
  // whoever else is at work is so with its last part; one that is not running needs a core
  for (unsigned n = 0; done_.load(std::memory_order_acquire) != parts;) pass(n);
  if (failed_.load(std::memory_order_relaxed)) {
    failed_.store(false, std::memory_order_relaxed);
    std::rethrow_exception(std::exchange(failure_, nullptr));
  }
}

// Of the task: it is the asking thread's loops that it helps with.
void ThreadTeam::Loops::assist() noexcept {
  const ExecutorScope within(nullptr);
  if (!team_.own_.help()) pass(pauses_);
}

void ThreadTeam::work() noexcept {
  for (;;) {
    const std::uint64_t seen = calls_.load(std::memory_order_acquire);  // first: who calls after it is not missed
    if (takeTask() || own_.help() || aside_.help()) continue;
    if (stop_.load(std::memory_order_acquire)) return;
    const auto until = std::chrono::steady_clock::now() + kLookout;
    for (int n = 1; calls_.load(std::memory_order_acquire) == seen; ++n) {
      relax();
      if (n % 64 == 0 && std::chrono::steady_clock::now() > until) calls_.wait(seen, std::memory_order_acquire);
    }
  }
}

void ThreadTeam::wake() noexcept {
  if (workers_.empty()) return;
  calls_.fetch_add(1, std::memory_order_release);
  calls_.notify_all();
}

bool ThreadTeam::offer(void (*task)(void* what), void* what) noexcept {
  if (workers_.empty() || task_state_.load(std::memory_order_acquire) != Task::none) return false;
  task_ = task;
  what_ = what;
  task_state_.store(Task::offered, std::memory_order_release);
  wake();
  return true;
}

bool ThreadTeam::revoked() noexcept {
  Task state = Task::offered;
  return task_state_.compare_exchange_strong(state, Task::none, std::memory_order_acq_rel);
}

bool ThreadTeam::takeTask() noexcept {
  Task state = Task::offered;
  if (task_state_.load(std::memory_order_relaxed) != state ||
      !task_state_.compare_exchange_strong(state, Task::taken, std::memory_order_acq_rel)) {
    return false;
  }
  try {
    const ExecutorScope scope(&aside_);
    task_(what_);
  } catch (...) {
    failure_ = std::current_exception();
  }
  task_state_.store(Task::done, std::memory_order_release);
  return true;
}

void ThreadTeam::awaitTask() {
  const ExecutorScope within(nullptr);
  for (unsigned n = 0; task_state_.load(std::memory_order_acquire) != Task::done;) {
    if (!aside_.help()) pass(n);
  }
  const std::exception_ptr failure = std::exchange(failure_, nullptr);
  task_state_.store(Task::none, std::memory_order_release);
  if (failure) std::rethrow_exception(failure);
}

}  // namespace palpate
