#pragma once

#include <atomic>

namespace palpate {

/// While it lives, no other thread comes past one with the same flag: for what a library keeps once for the whole
/// program. Waits, so not for the tick.
class OneAtATime {
 public:
  explicit OneAtATime(std::atomic_flag& busy) noexcept : busy_(busy) {
    while (busy_.test_and_set(std::memory_order_acquire)) busy_.wait(true, std::memory_order_relaxed);
  }
  ~OneAtATime() {
    busy_.clear(std::memory_order_release);
    busy_.notify_one();
  }
  OneAtATime(const OneAtATime&) = delete;
  OneAtATime& operator=(const OneAtATime&) = delete;

 private:
  std::atomic_flag& busy_;
};

}  // namespace palpate
