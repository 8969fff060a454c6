#pragma once

#include <array>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/math/types.h"

namespace palpate {

/// Everything here is about the surfaces at their start positions, after refit().

/// A point of a surface.
struct SurfacePoint {
  int triangle = -1;
  std::array<double, 3> weight{};  ///< barycentric
  Vec3 position = Vec3::Zero();    ///< [m]
  Vec3 normal = Vec3::UnitZ();  ///< outward, unit: of the face, of both faces at an edge, weighted by angle at a corner
  double distance = 0;          ///< from the point asked for [m]
};

/// Whether a closed surface encloses a point. Counts crossings of a ray; takes another ray where one comes near an
/// edge, and the winding number when none is clear. False for surfaces that are not closed. Points on the surface
/// itself may count either way.
bool inside(const CollisionSurface& surface, const Vec3& point);

/// Closest point of a surface that has a triangle at least.
SurfacePoint closestPoint(const CollisionSurface& surface, const Vec3& point);

/// A point of one surface that lies in the solid bounded by the other: a vertex, or a point of an edge.
struct OverlapPoint {
  bool of_first = true;  ///< the point belongs to the first surface, the triangle to the second; else the reverse
  std::array<int, 3> vertex{-1, -1, -1};  ///< one or two are used
  std::array<double, 3> weight{};
  int triangle = -1;  ///< of the other surface: where the way out is shortest
  std::array<int, 3> other_vertex{-1, -1, -1};
  std::array<double, 3> other_weight{};
  Vec3 normal = Vec3::UnitZ();  ///< out of the other surface, unit
  double depth = 0;             ///< distance to the other surface [m]
};

/// Where two surfaces intersect; appends. Vertices of each inside the other and, for edges that pass through with both
/// ends outside, the middle of each piece inside. Where an edge crosses a face but nothing of it is inside (a surface
/// that is not closed, rounding) the crossing itself is given, with depth 0. So nothing found means that no edge
/// crosses a face and neither surface encloses the other.
void findOverlaps(const CollisionSurface& a, const CollisionSurface& b, std::vector<OverlapPoint>& out);

}  // namespace palpate
