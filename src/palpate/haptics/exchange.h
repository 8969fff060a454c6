#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace palpate {

/// Hands the newest complete value from one writing thread to one reading thread; neither ever waits. Three copies: the
/// writer fills one, the reader looks at one, the third changes hands by one atomic exchange. Values that the reader
/// did not fetch in time are overwritten.
template <typename T>
class LatestValue {
 public:
  LatestValue() = default;
  LatestValue(const LatestValue&) = delete;
  LatestValue& operator=(const LatestValue&) = delete;

  /// Writer only: makes `value` the newest one. @returns whether the one before was never read
  bool write(const T& value) noexcept {
    slots_[writing_].value = value;
    const std::uint8_t before =
        middle_.exchange(static_cast<std::uint8_t>(writing_ | kFresh), std::memory_order_acq_rel);
    writing_ = before & kIndex;
    return (before & kFresh) != 0;
  }

  /// Reader only: the newest value, or nullptr before the first write. It stays as it is until the next read().
  const T* read() noexcept {
    if (middle_.load(std::memory_order_relaxed) & kFresh) {
      reading_ = middle_.exchange(reading_, std::memory_order_acq_rel) & kIndex;
      has_value_ = true;
    }
    return has_value_ ? &slots_[reading_].value : nullptr;
  }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kFresh = 4;  // the middle slot was written after the last read
  // Slots and indices of the two threads lie on different cache lines, or each write would slow the other's reads.
  struct alignas(64) Slot {
    T value{};
  };

  std::array<Slot, 3> slots_{};
  alignas(64) std::uint8_t writing_ = 0;
  alignas(64) std::uint8_t reading_ = 1;
  bool has_value_ = false;
  alignas(64) std::atomic<std::uint8_t> middle_{2};
};

}  // namespace palpate
