#include "palpate/contact/obstacle.h"

#include <cmath>

#include "palpate/mesh/shapes.h"

namespace palpate {
namespace {

constexpr int kSphereLevels = 5;      // 8,192 triangles
constexpr int kCapsuleSegments = 64;  // around

Surface placed(Surface surface, const Pose& pose) {
  for (Vec3& p : surface.vertices) p = pose.apply(p);
  return surface;
}

std::optional<Surface> surfaceOfShape(const PlaneShape&) { return std::nullopt; }

std::optional<Surface> surfaceOfShape(const MeshShape& mesh) { return mesh.surface; }

std::optional<Surface> surfaceOfShape(const BoxShape& box) {
  return placed(boxSurface(2.0 * box.half_extents), box.pose);
}

std::optional<Surface> surfaceOfShape(const SphereShape& sphere) {
  return placed(sphereSurface(sphere.radius, kSphereLevels), {sphere.center, Quat::Identity()});
}

std::optional<Surface> surfaceOfShape(const CapsuleShape& capsule) {
  const Vec3 axis = capsule.b - capsule.a;
  const Vec3 center = 0.5 * (capsule.a + capsule.b);
  const double length = axis.norm();
  if (!(length > 0)) return surfaceOfShape(SphereShape{center, capsule.radius});
  return placed(capsuleSurface(capsule.radius, length, kCapsuleSegments),
                {center, Quat::FromTwoVectors(Vec3::UnitZ(), axis)});
}

}  // namespace

std::optional<Surface> surfaceOf(const Obstacle& obstacle) {
  return std::visit([](const auto& shape) { return surfaceOfShape(shape); }, obstacle.shape);
}

}  // namespace palpate
