#include "palpate/live/handle_path.h"

#include <algorithm>

namespace palpate {

void HandlePath::add(const PathPoint& point) noexcept {
  if (empty() || point.index != end_) first_ = point.index;
  points_[static_cast<std::size_t>(point.index & (kCapacity - 1))] = point;
  end_ = point.index + 1;
  first_ = std::max(first_, end_ - kCapacity);
}

}  // namespace palpate
