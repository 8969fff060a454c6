#include "palpate/contact/obstacle.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

Proximity toBall(const Vec3& center, double radius, const Vec3& point) {
  const Vec3 d = point - center;
  const double distance = d.norm();
  return {distance - radius, distance > 1e-12 ? Vec3(d / distance) : Vec3::UnitZ()};
}

Proximity toShape(const PlaneShape& plane, const Vec3& point) {
  return {plane.normal.dot(point - plane.point), plane.normal};
}

Proximity toShape(const SphereShape& sphere, const Vec3& point) { return toBall(sphere.center, sphere.radius, point); }

Proximity toShape(const CapsuleShape& capsule, const Vec3& point) {
  const Vec3 axis = capsule.b - capsule.a;
  const double length2 = axis.squaredNorm();
  const double t = length2 > 0 ? std::clamp((point - capsule.a).dot(axis) / length2, 0.0, 1.0) : 0.0;
  return toBall(capsule.a + t * axis, capsule.radius, point);
}

Proximity toShape(const BoxShape& box, const Vec3& point) {
  const Vec3 local = box.pose.rotation.conjugate() * (point - box.pose.position);
  const Vec3 excess = local.cwiseAbs() - box.half_extents;
  Vec3 normal;
  double gap = 0;
  if (excess.maxCoeff() > 0) {
    const Vec3 outside = excess.cwiseMax(0.0);
    gap = outside.norm();
    normal = outside / gap;
  } else {
    int axis = 0;
    gap = excess.maxCoeff(&axis);
    normal = Vec3::Unit(axis);
  }
  for (int k = 0; k < 3; ++k) {
    if (local[k] < 0) normal[k] = -normal[k];
  }
  return {gap, box.pose.rotation * normal};
}

}  // namespace

Proximity proximity(const Obstacle& obstacle, const Vec3& point) {
  return std::visit([&](const auto& shape) { return toShape(shape, point); }, obstacle.shape);
}

}  // namespace palpate
