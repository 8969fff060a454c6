#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate {

/// Ring from one writing to one reading thread, e.g. of TickRecords to the thread that stores them. A full ring drops
/// the new value and counts it: the writer never waits.
template <typename T>
class RecordQueue {
 public:
  /// @param capacity  values that fit, at least 1; all memory is taken here
  explicit RecordQueue(std::size_t capacity) : ring_(capacity + 1) {}
  RecordQueue(const RecordQueue&) = delete;
  RecordQueue& operator=(const RecordQueue&) = delete;

  /// Writer only. @return false when the value was dropped
  bool push(const T& value) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t next = tail + 1 == ring_.size() ? 0 : tail + 1;
    if (next == head_.load(std::memory_order_acquire)) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    ring_[tail] = value;
    tail_.store(next, std::memory_order_release);
    return true;
  }

  /// Reader only. @return false when the ring is empty
  bool pop(T& value) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return false;
    value = ring_[head];
    head_.store(head + 1 == ring_.size() ? 0 : head + 1, std::memory_order_release);
    return true;
  }

  /// Values dropped so far; any thread.
  std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  std::vector<T> ring_;
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
  alignas(64) std::atomic<std::uint64_t> dropped_{0};
};

}  // namespace palpate
