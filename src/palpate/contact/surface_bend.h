#pragma once

#include <span>

#include "palpate/contact/collision_surface.h"
#include "palpate/math/types.h"

namespace palpate {

/// How a surface's normal turns around a place, as far as 5 mm from it: at x it lies along normal + bend (x - place).
/// The mean of the derivative of the normals of the triangles there that face about the same way, which is all in the
/// edges between them; what is nearer counts more. Where the surface is flat, or little of it is there, it is exactly
/// zero, so that what rests on a plane is not changed; creases sharper than 35 degrees bound what is looked at.
/// @param triangles  of the surface, near the place: where to begin
/// @param place      on the surface, as it is at `start` [m]
/// @param normal     unit
/// @returns bend, symmetric, with bend * normal = 0; positive where the surface is convex [1/m]
Mat3 surfaceBend(const CollisionSurface& surface, std::span<const int> triangles, const Vec3& place,
                 const Vec3& normal);

}  // namespace palpate
