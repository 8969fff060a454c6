#include "palpate/contact/pair_exclusion.h"

#include "palpate/contact/feature_distance.h"

namespace palpate {
namespace {

using Corners = std::array<Vec3, 3>;

Corners cornersOf(const CollisionSurface& surface, const std::array<int, 3>& triangle) {
  Corners out;
  for (std::size_t k = 0; k < 3; ++k) out[k] = surface.start[static_cast<std::size_t>(triangle[k])];
  return out;
}

struct Box {
  Vec3 low, high;
  explicit Box(const Corners& p) : low(p[0].cwiseMin(p[1]).cwiseMin(p[2])), high(p[0].cwiseMax(p[1]).cwiseMax(p[2])) {}
  void include(const Box& other) {
    low = low.cwiseMin(other.low);
    high = high.cwiseMax(other.high);
  }
  double distance(const Box& other) const { return (low - other.high).cwiseMax(other.low - high).cwiseMax(0.0).norm(); }
};

// Of triangles that do not pass through each other.
double distance(const Corners& p, const Corners& q) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    least = std::min(least, closestOnTriangle(p[i], q[0], q[1], q[2]).distance);
    least = std::min(least, closestOnTriangle(q[i], p[0], p[1], p[2]).distance);
    for (std::size_t j = 0; j < 3; ++j) {
      least = std::min(least, closestOnSegments(p[i], p[(i + 1) % 3], q[j], q[(j + 1) % 3]).distance);
    }
  }
  return least;
}

}  // namespace

std::vector<char> marksNear(const CollisionSurface& surface, const std::vector<char>& marks,
                            const CollisionSurface& other, double near) {
  std::vector<Corners> marked;
  std::vector<Box> boxes;
  for (const auto& t : surface.triangles()) {
    if (std::none_of(t.begin(), t.end(), [&](int v) { return marks[static_cast<std::size_t>(v)] != 0; })) continue;
    marked.push_back(cornersOf(surface, t));
    boxes.emplace_back(marked.back());
  }
  std::vector<char> out(other.start.size(), 0);
  if (marked.empty()) return out;
  Box around = boxes.front();
  for (const Box& box : boxes) around.include(box);
  for (const auto& t : other.triangles()) {
    const Corners corners = cornersOf(other, t);
    const Box box(corners);
    if (box.distance(around) > near) continue;
    for (std::size_t k = 0; k < marked.size(); ++k) {
      if (box.distance(boxes[k]) > near || distance(corners, marked[k]) > near) continue;
      for (const int v : t) out[static_cast<std::size_t>(v)] = 1;
      break;
    }
  }
  return out;
}

}  // namespace palpate
