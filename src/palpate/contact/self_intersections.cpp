#include "palpate/contact/self_intersections.h"

#include <algorithm>
#include <cmath>

#include "palpate/contact/meeting_clusters.h"

namespace palpate {
namespace {

constexpr double kRounding = 1e-9;  // of a triangle's size

using Triangle = std::array<Vec3, 3>;

Triangle triangleAt(const CollisionSurface& s, int t) {
  const auto& v = s.triangles()[static_cast<std::size_t>(t)];
  return {s.start[v[0]], s.start[v[1]], s.start[v[2]]};
}

bool shareVertex(const CollisionSurface& s, int t, int u) {
  for (const int v : s.triangles()[static_cast<std::size_t>(t)])
    for (const int w : s.triangles()[static_cast<std::size_t>(u)])
      if (v == w) return true;
  return false;
}

// Whether a segment passes through a triangle, from one side of its plane to the other.
bool passes(const Vec3& p, const Vec3& q, double height_p, double height_q, const Triangle& t) {
  if (!((height_p < 0 && height_q > 0) || (height_p > 0 && height_q < 0))) return false;
  const Vec3 d = q - p, a = t[0] - p, b = t[1] - p, c = t[2] - p;
  const double wa = d.dot(b.cross(c)), wb = d.dot(c.cross(a)), wc = d.dot(a.cross(b));
  return (wa >= 0 && wb >= 0 && wc >= 0) || (wa <= 0 && wb <= 0 && wc <= 0);
}

// Heights of the corners of u over the plane of t, times twice its area; what may be rounding is zero, as parts of a
// flat face would else cross. @returns whether they are on both sides
bool straddles(const Triangle& t, const Triangle& u, std::array<double, 3>& height) {
  const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]);
  const double area = n.norm(), rounding = kRounding * area * std::sqrt(area);
  for (int k = 0; k < 3; ++k) {
    height[k] = n.dot(u[k] - t[0]);
    if (std::abs(height[k]) < rounding) height[k] = 0;
  }
  return std::min({height[0], height[1], height[2]}) < 0 && std::max({height[0], height[1], height[2]}) > 0;
}

bool anyEdgePasses(const Triangle& u, const std::array<double, 3>& height, const Triangle& t) {
  for (int k = 0; k < 3; ++k) {
    const int l = (k + 1) % 3;
    if (passes(u[k], u[l], height[k], height[l], t)) return true;
  }
  return false;
}

bool intersect(const Triangle& t, const Triangle& u) {
  std::array<double, 3> of_u{}, of_t{};
  return straddles(t, u, of_u) && straddles(u, t, of_t) && (anyEdgePasses(u, of_u, t) || anyEdgePasses(t, of_t, u));
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
      if (!intersect(triangleAt(s, t), triangleAt(s, u)) || excluded(t, u)) continue;
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
