#include "palpate/contact/nearest_place.h"

#include <limits>

#include "palpate/math/triangle.h"

namespace palpate {

NearestPlace nearestFrom(const CollisionSurface& surface, std::span<const int> triangles, const Vec3& point) {
  constexpr int kMostMoves = 32;  // bounds the time
  constexpr double kOnIt = 1e-6;  // [m]: nearer than that no line is known
  NearestPlace out;
  double least = std::numeric_limits<double>::infinity();
  Vec3 place = Vec3::Zero();
  const auto look = [&](int t) {
    const std::array<Vec3, 3> x = surface.startCorners(t);
    const TrianglePoint p = closestOnTriangle(point, x[0], x[1], x[2]);
    if (!(p.distance < least)) return;
    least = p.distance;
    place = p.weight[0] * x[0] + p.weight[1] * x[1] + p.weight[2] * x[2];
    out.triangle = t;
    out.weight = p.weight;
  };
  for (const int t : triangles) look(t);
  for (int move = 0, from = -1; move < kMostMoves && from != out.triangle; ++move) {
    from = out.triangle;
    for (const int v : surface.triangles()[static_cast<std::size_t>(from)]) {
      for (const int t : surface.trianglesAtVertex(v)) look(t);
    }
  }
  const Vec3 outward = surface.outwardNormal(out.triangle, out.weight, 0);
  const double side = outward.dot(point - place) < 0 ? -1 : 1;
  out.distance = side * least;
  out.normal = least > kOnIt ? Vec3(side / least * (point - place)) : outward;
  return out;
}

}  // namespace palpate
