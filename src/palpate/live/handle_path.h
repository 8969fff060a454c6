#pragma once

#include <vector>

#include "palpate/live/live_model.h"

namespace palpate {

/// The last second of the proxy's path. Memory is taken once.
class HandlePath {
 public:
  static constexpr std::int64_t kCapacity = 1024;
  HandlePath() : points_(kCapacity) {}

  /// Index after that of the point before; any other begins a new path.
  void add(const PathPoint& point) noexcept;
  void clear() noexcept { first_ = end_ = 0; }
  bool holds(std::int64_t index) const noexcept { return index >= first_ && index < end_; }
  std::int64_t first() const noexcept { return first_; }
  std::int64_t end() const noexcept { return end_; }  ///< one past the last
  bool empty() const noexcept { return end_ == first_; }
  const PathPoint& operator[](std::int64_t index) const noexcept {
    return points_[static_cast<std::size_t>(index & (kCapacity - 1))];
  }

 private:
  std::vector<PathPoint> points_;
  std::int64_t first_ = 0, end_ = 0;
};

}  // namespace palpate
