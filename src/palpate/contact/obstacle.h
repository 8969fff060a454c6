#pragma once

#include <optional>
#include <string>
#include <variant>

#include "palpate/math/types.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Solid half space below the plane through `point`.
struct PlaneShape {
  Vec3 point = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();  ///< unit, out of the solid
};
struct BoxShape {
  Pose pose;                                 ///< center and axes
  Vec3 half_extents = Vec3::Constant(0.05);  ///< [m]
};
struct SphereShape {
  Vec3 center = Vec3::Zero();
  double radius = 0.05;  ///< [m]
};
struct CapsuleShape {
  Vec3 a = Vec3::Zero();
  Vec3 b = Vec3::UnitX();
  double radius = 0.02;  ///< [m]
};

/// Closed surface in world coordinates, triangles counter-clockwise from outside; an open one is a thin sheet.
struct MeshShape {
  Surface surface;
};

/// Fixed solid that bodies touch.
struct Obstacle {
  std::variant<PlaneShape, BoxShape, SphereShape, CapsuleShape, MeshShape> shape;
  std::optional<double> friction;  ///< Coulomb coefficient against any body; absent: the body's own
  std::string name;
};

/// Signed distance from the plane [m].
inline double gap(const PlaneShape& plane, const Vec3& point) { return plane.normal.dot(point - plane.point); }

/// Triangle surface of a solid, in world coordinates; none for a plane, which needs none. Spheres and capsules deviate
/// from their triangles by 2.5e-3 of the radius at most, inwards.
std::optional<Surface> surfaceOf(const Obstacle& obstacle);

}  // namespace palpate
