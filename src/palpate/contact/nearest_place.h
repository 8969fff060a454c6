#pragma once

#include <array>
#include <span>

#include "palpate/contact/collision_surface.h"
#include "palpate/math/types.h"

namespace palpate {

/// Place of a surface that no place around it is nearer than, to a point.
struct NearestPlace {
  int triangle = -1;
  std::array<double, 3> weight{};  ///< barycentric
  Vec3 normal;                     ///< unit: the line to the point, outward, or of the surface where the point is on it
  double distance = 0;             ///< outside positive [m]
};

/// Goes from triangle to triangle as long as the next one is nearer.
/// @param triangles  of the surface, near the place: where to begin; at least one
/// @param surface    as it is at `start`
NearestPlace nearestFrom(const CollisionSurface& surface, std::span<const int> triangles, const Vec3& point);

}  // namespace palpate
