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
constexpr std::chrono::microseconds kLookout{500};

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
bool ThreadTeam::takePart(std::uint64_t& ticket) noexcept {
  while (nextOf(ticket) < partsOf(ticket)) {
    if (ticket_.compare_exchange_weak(ticket, ticket + 1, std::memory_order_acq_rel, std::memory_order_acquire)) {
      return true;
    }
  }
  return false;
}

void ThreadTeam::finish(int i) noexcept {
  try {
    part_(loop_, i);
  } catch (...) {
    if (!failed_.exchange(true)) failure_ = std::current_exception();
  }
  done_.fetch_add(1, std::memory_order_release);
}

void ThreadTeam::work() noexcept {
  std::uint64_t ticket = ticket_.load(std::memory_order_acquire);
  for (;;) {
    while (takePart(ticket)) {
      finish(static_cast<int>(nextOf(ticket)));
      ticket = ticket_.load(std::memory_order_acquire);
    }
    if (stop_.load(std::memory_order_acquire)) return;
    const std::uint64_t seen = ticket;
    const auto until = std::chrono::steady_clock::now() + kLookout;
    for (int n = 1; (ticket = ticket_.load(std::memory_order_acquire)) == seen; ++n) {
      relax();
      if (n % 64 == 0 && std::chrono::steady_clock::now() > until) ticket_.wait(seen, std::memory_order_acquire);
    }
  }
}

void ThreadTeam::run(int parts, void (*part)(void* loop, int i), void* loop) {
  if (parts > kMaxParts) throw RunError("a loop of " + std::to_string(parts) + " parts: too many");
  part_ = part;
  loop_ = loop;
  done_.store(0, std::memory_order_relaxed);
  std::uint64_t ticket = makeTicket(numberOf(ticket_.load(std::memory_order_relaxed)) + 1, parts);
  ticket_.store(ticket, std::memory_order_release);
  if (!workers_.empty()) ticket_.notify_all();
  while (takePart(ticket)) {
    finish(static_cast<int>(nextOf(ticket)));
    ticket = ticket_.load(std::memory_order_acquire);
  }
  // whoever else is at work is so with its last part; one that is not running needs a core
  for (int n = 1; done_.load(std::memory_order_acquire) != parts; ++n) {
    relax();
    if (n % 1024 == 0) std::this_thread::yield();
  }
  if (failed_.load(std::memory_order_relaxed)) {
    failed_.store(false, std::memory_order_relaxed);
    std::rethrow_exception(std::exchange(failure_, nullptr));
  }
}

void ThreadTeam::wake() noexcept {
  ticket_.store(makeTicket(numberOf(ticket_.load(std::memory_order_relaxed)) + 1, 0), std::memory_order_release);
  ticket_.notify_all();
}

}  // namespace palpate
