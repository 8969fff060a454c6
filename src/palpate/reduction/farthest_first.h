#pragma once

#include <limits>
#include <vector>

namespace palpate {

constexpr double kAlike = 0.7;       ///< cosine of the normals within a group of contacts
constexpr double kOtherGroup = 1e3;  ///< [m]: farther than any of like facing

/// Points in groups about seeds.
struct Groups {
  std::vector<int> owner;  ///< of each point, the nearest seed's group
  int count = 0;           ///< of seeds
  double farthest = 0;     ///< of a point from its seed
};

/// At most so many groups, at least one: about a first seed, then always about the point that is farthest from all.
/// @param distance  between two points, by their indices
template <class Distance>
Groups farthestFirst(int points, int seed, int most, Distance distance) {
  Groups out;
  out.owner.assign(static_cast<std::size_t>(points), 0);
  std::vector<double> nearest(static_cast<std::size_t>(points), std::numeric_limits<double>::infinity());
  while (seed >= 0 && out.count < most) {
    int next = -1;
    out.farthest = 0;
    for (int i = 0; i < points; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double d = distance(i, seed);
      if (d < nearest[k]) {
        nearest[k] = d;
        out.owner[k] = out.count;
      }
      if (nearest[k] > out.farthest) {
        out.farthest = nearest[k];
        next = i;
      }
    }
    ++out.count;
    seed = next;
  }
  return out;
}

}  // namespace palpate
