#pragma once

#include <optional>
#include <string>
#include <variant>

#include "palpate/math/types.h"

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

/// Fixed solid that bodies touch.
struct Obstacle {
  std::variant<PlaneShape, BoxShape, SphereShape, CapsuleShape> shape;
  std::optional<double> friction;  ///< Coulomb coefficient against any body; absent: the body's own
  std::string name;
};

struct Proximity {
  double gap = 0;               ///< signed distance from the solid, negative inside [m]
  Vec3 normal = Vec3::UnitZ();  ///< unit gradient of the gap: out of the solid
};

/// Signed distance and its gradient. Where the gradient is not unique (center of a sphere, axis of a capsule, inner
/// skeleton of a box) one fixed choice is made.
Proximity proximity(const Obstacle& obstacle, const Vec3& point);

}  // namespace palpate
