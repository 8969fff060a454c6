#include "palpate/contact/friction_table.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace palpate {

void FrictionTable::setBody(int body, double coefficient) {
  if (static_cast<std::size_t>(body) >= bodies_.size()) bodies_.resize(static_cast<std::size_t>(body) + 1, 0.0);
  bodies_[body] = coefficient;
}

void FrictionTable::setObstacle(int obstacle, std::optional<double> coefficient) {
  if (static_cast<std::size_t>(obstacle) >= obstacles_.size())
    obstacles_.resize(static_cast<std::size_t>(obstacle) + 1);
  obstacles_[obstacle] = coefficient;
}

void FrictionTable::setPair(int first, int second, double coefficient) {
  pairs_.push_back({std::min(first, second), std::max(first, second), coefficient});
}

double FrictionTable::operator()(int first, int second) const {
  const int low = std::min(first, second);
  const int high = std::max(first, second);
  for (const Pair& p : pairs_) {
    if (p.low == low && p.high == high) return scale_ * p.coefficient;
  }
  if (low < 0) {
    const auto index = static_cast<std::size_t>(-1 - low);
    if (index < obstacles_.size() && obstacles_[index]) return scale_ * *obstacles_[index];
    return high >= 0 ? scale_ * bodies_[high] : 0.0;
  }
  return scale_ * std::sqrt(bodies_[low] * bodies_[high]);
}

}  // namespace palpate
