#pragma once

// Signed distances from the solids that obstacles are made of, in closed form.

#include <algorithm>

#include "palpate/contact/obstacle.h"

namespace palpate::test {

/// Signed distance from an analytic solid [m], written apart from the product, which works on its triangles.
inline double signedDistance(const PlaneShape& plane, const Vec3& p) { return plane.normal.dot(p - plane.point); }
inline double signedDistance(const SphereShape& s, const Vec3& p) { return (p - s.center).norm() - s.radius; }
inline double signedDistance(const CapsuleShape& c, const Vec3& p) {
  const Vec3 axis = c.b - c.a;
  const double length2 = axis.squaredNorm();
  const double t = length2 > 0 ? std::clamp((p - c.a).dot(axis) / length2, 0.0, 1.0) : 0.0;
  return (p - c.a - t * axis).norm() - c.radius;
}
inline double signedDistance(const BoxShape& box, const Vec3& p) {
  const Vec3 excess = (box.pose.rotation.conjugate() * (p - box.pose.position)).cwiseAbs() - box.half_extents;
  return excess.cwiseMax(0.0).norm() + std::min(excess.maxCoeff(), 0.0);
}
inline double signedDistance(const MeshShape&, const Vec3&) { return 1.0; }

}  // namespace palpate::test
