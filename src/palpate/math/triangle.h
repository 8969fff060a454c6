#pragma once

#include <array>

#include "palpate/math/types.h"

namespace palpate {

/// Closest point of a triangle to a point.
struct TrianglePoint {
  std::array<double, 3> weight{};  ///< barycentric, >= 0, sum 1; exactly 0 for corners that take no part
  double distance = 0;             ///< [m]
};

/// Closest point of triangle abc to p. A triangle without area is taken as its longest edges.
TrianglePoint closestOnTriangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c);

using TriangleCorners = std::array<Vec3, 3>;

/// Whether an edge of one triangle passes through the other, from one side of its plane to the other; what only
/// touches, but for rounding, does not.
bool trianglesCross(const TriangleCorners& t, const TriangleCorners& u);

}  // namespace palpate
