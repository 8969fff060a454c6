#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "palpate/contact/collision_surface.h"

namespace palpate {

/// Of boxes at the start of the motion.
inline bool overlapAtStart(const MovingBox& p, const MovingBox& q) { return p.startGaps(q).maxCoeff() <= 0; }

/// Calls visit(cluster of a, cluster of b) for those under a pair of nodes whose boxes overlap at the start; within one
/// surface each pair once, and each cluster with itself; among those that are wanted(cluster of a, cluster of b). Both
/// must have nodes and be refitted.
template <class Wanted, class Visit>
void meetingClusters(const CollisionSurface& a, const CollisionSurface& b, std::pair<int, int> root, Wanted wanted,
                     Visit visit) {
  const bool self = &a == &b;
  std::vector<std::pair<int, int>> stack{root};
  while (!stack.empty()) {
    const auto [i, j] = stack.back();
    stack.pop_back();
    if (!overlapAtStart(a.nodeBox(i), b.nodeBox(j))) continue;
    const auto &na = a.nodes()[static_cast<std::size_t>(i)], &nb = b.nodes()[static_cast<std::size_t>(j)];
    if (na.right < 0 && nb.right < 0) {
      if (!wanted(na.cluster, nb.cluster) || !overlapAtStart(a.leafBox(i), b.leafBox(j))) continue;
      visit(na.cluster, nb.cluster);
    } else if (self && i == j) {
      stack.emplace_back(i + 1, i + 1);
      stack.emplace_back(na.right, na.right);
      stack.emplace_back(i + 1, na.right);
    } else if (nb.right < 0 || (na.right >= 0 && a.nodeBox(i).size() >= b.nodeBox(j).size())) {
      stack.emplace_back(i + 1, j);
      stack.emplace_back(na.right, j);
    } else {
      stack.emplace_back(i, j + 1);
      stack.emplace_back(i, nb.right);
    }
  }
}
/// The same under the roots, all of them.
template <class Visit>
void meetingClusters(const CollisionSurface& a, const CollisionSurface& b, Visit visit) {
  meetingClusters(
      a, b, {0, 0}, [](int, int) { return true; }, visit);
}

}  // namespace palpate
