#pragma once

#include <atomic>
#include <stdexcept>
#include <utility>

namespace palpate {

/// Leaves a job that was told to end; see CancellationScope.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled") {}
};

/// While it lives, long jobs that the calling thread does (building a scene: meshes, rest) end soon after `token`
/// becomes true, by throwing Cancelled. What a run itself calls, steps and ticks, never asks.
class CancellationScope {
 public:
  explicit CancellationScope(const std::atomic<bool>* token) noexcept : before_(std::exchange(token_, token)) {}
  ~CancellationScope() { token_ = before_; }
  CancellationScope(const CancellationScope&) = delete;
  CancellationScope& operator=(const CancellationScope&) = delete;

  static bool cancelled() noexcept { return token_ != nullptr && token_->load(std::memory_order_relaxed); }

 private:
  inline static thread_local const std::atomic<bool>* token_ = nullptr;
  const std::atomic<bool>* before_;
};

/// Of a long job, every tenth of a second or oftener; cheap. @throws Cancelled
inline void throwIfCancelled() {
  if (CancellationScope::cancelled()) throw Cancelled();
}

}  // namespace palpate
