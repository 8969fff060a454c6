#pragma once

#include <functional>

#include "palpate/mesh/surface_measures.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Scalar field, negative inside; near its zero set about the distance to it [m].
using ImplicitFunction = std::function<double(const Vec3&)>;

/// Distances to simple solids [m]; the ellipsoid's is a first-order estimate.
double sphereDistance(const Vec3& x, const Vec3& center, double radius);
double ellipsoidDistance(const Vec3& x, const Vec3& center, const Vec3& radii);
/// Capsule whose radius runs from radius_a at a to radius_b at b.
double taperedCapsuleDistance(const Vec3& x, const Vec3& a, const Vec3& b, double radius_a, double radius_b);
/// Union that rounds the seam over about `blend` [m] (polynomial smooth minimum); negative blends are not allowed.
double smoothUnion(double a, double b, double blend);
/// Intersection with a rounded seam.
double smoothIntersection(double a, double b, double blend);

/// Meshes the zero set by surface nets: a vertex for every grid cell with a change of sign, a quad for every grid edge
/// with one, then rounds of tangential smoothing with projection onto the zero set. Closed if the set lies inside the
/// box.
/// @param cell    grid size [m], about the edge length of the triangles; made up to 12 % smaller where that is needed
/// for a manifold
/// @param rounds  smoothing rounds
Surface meshImplicit(const ImplicitFunction& f, const Bounds& box, double cell, int rounds = 12);

}  // namespace palpate
