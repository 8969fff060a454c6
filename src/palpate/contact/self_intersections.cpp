#include "palpate/contact/self_intersections.h"

#include <algorithm>

#include "palpate/contact/meeting_clusters.h"
#include "palpate/math/triangle.h"

namespace palpate {
namespace {

TriangleCorners triangleAt(const CollisionSurface& s, int t) {
  const auto& v = s.triangles()[static_cast<std::size_t>(t)];
  return {s.start[v[0]], s.start[v[1]], s.start[v[2]]};
}

bool shareVertex(const CollisionSurface& s, int t, int u) {
  for (const int v : s.triangles()[static_cast<std::size_t>(t)])
    for (const int w : s.triangles()[static_cast<std::size_t>(u)])
      if (v == w) return true;
  return false;
}

// Of two clusters, or of one with itself.
void intersectClusters(const CollisionSurface& s, int c, int d, const SelfExclusion* exclusion,
                       std::vector<std::array<int, 2>>& out) {
  const auto excluded = [&](int t, int u) {
    return exclusion != nullptr &&
           exclusion->excludes(s.triangles()[static_cast<std::size_t>(t)], s.triangles()[static_cast<std::size_t>(u)]);
  };
  const auto boxes_c = s.triangleBoxes(c), boxes_d = s.triangleBoxes(d);
  const auto triangles_c = s.trianglesOfCluster(c), triangles_d = s.trianglesOfCluster(d);
  MovingBox around = boxes_d.front();
  for (const MovingBox& box : boxes_d) around.include(box);
  for (std::size_t i = 0; i < boxes_c.size(); ++i) {
    if (!overlapAtStart(boxes_c[i], around)) continue;
    for (std::size_t j = c == d ? i + 1 : 0; j < boxes_d.size(); ++j) {
      const int t = triangles_c[i], u = triangles_d[j];
      if (!overlapAtStart(boxes_c[i], boxes_d[j]) || shareVertex(s, t, u)) continue;
      if (!trianglesCross(triangleAt(s, t), triangleAt(s, u)) || excluded(t, u)) continue;
      out.push_back({std::min(t, u), std::max(t, u)});
    }
  }
}

}  // namespace

void findSelfIntersections(const CollisionSurface& surface, std::vector<std::array<int, 2>>& out,
                           const SelfExclusion* exclusion, const PairFront* front, double moved) {
  if (surface.nodes().empty()) return;
  const auto below = [&](int a, int b) {
    meetingClusters(
        surface, surface, {a, b},
        [&](int c, int d) { return exclusion == nullptr || !exclusion->excludesClusters(c, d); },
        [&](int c, int d) { intersectClusters(surface, c, d, exclusion, out); });
  };
  if (exclusion != nullptr && front != nullptr && front->known()) {
    front->nearPairs(moved, below);
  } else {
    below(0, 0);
  }
}

}  // namespace palpate
