#pragma once

#include <array>
#include <span>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/math/types.h"

namespace palpate {

/// Outward unit normal of a triangle at `start`, where its vertices are placed first.
Vec3 normalAtStart(const CollisionSurface& surface, int triangle);

/// The flat piece of a surface around a place, as it is at `start`: triangles that hang together by edges and lie in
/// one plane, at most 256 of them.
class FlatPiece {
 public:
  /// @param triangles  of the surface, at the place: where to begin; that which faces most along `facing` gives the
  /// plane
  FlatPiece(const CollisionSurface& surface, std::span<const int> triangles, const Vec3& facing);

  /// Outward, unit; zero without triangles or where they have no area.
  const Vec3& normal() const { return normal_; }
  /// Unit, along the shortest edge of the triangle that gave the plane.
  const Vec3& along() const { return along_; }
  /// How far the line place + s direction stays on the piece.
  /// @param place      on it or near its plane [m]
  /// @param direction  unit, in its plane
  /// @returns least and greatest s, 0 between them [m]
  std::array<double, 2> extent(const Vec3& place, const Vec3& direction) const;

 private:
  Vec3 normal_ = Vec3::Zero(), along_ = Vec3::Zero();
  std::vector<std::array<Vec3, 3>> corners_;  // of its triangles
};

}  // namespace palpate
