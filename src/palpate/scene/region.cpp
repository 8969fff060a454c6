#include "palpate/scene/region.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "palpate/common/error.h"
#include "palpate/mesh/alien.h"

namespace palpate {
namespace {

bool inside(const SphereRegionConfig& r, const Vec3& x) { return (x - r.center).norm() <= r.radius; }
bool inside(const BoxRegionConfig& r, const Vec3& x) {
  return (x.array() >= r.min.array()).all() && (x.array() <= r.max.array()).all();
}
bool inside(const CapsuleRegionConfig& r, const Vec3& x) {
  const Vec3 axis = r.b - r.a;
  const double square = axis.squaredNorm();
  const double along = square > 0 ? std::clamp((x - r.a).dot(axis) / square, 0.0, 1.0) : 0.0;
  return (x - r.a - along * axis).norm() <= r.radius;
}
bool inside(const HalfspaceRegionConfig& r, const Vec3& x) { return r.normal.dot(x - r.point) >= 0; }
bool inside(const LandmarkRegionConfig&, const Vec3&) { return false; }
bool inside(const SpheresRegionConfig& r, const Vec3& x) {
  return std::any_of(r.centers.begin(), r.centers.end(), [&](const Vec3& c) { return (x - c).norm() <= r.radius; });
}

}  // namespace

RegionConfig resolvedRegion(const RegionConfig& region, const ShapeConfig& shape) {
  const auto* landmark = std::get_if<LandmarkRegionConfig>(&region);
  if (landmark == nullptr) return region;
  const auto* alien = std::get_if<AlienShapeConfig>(&shape);
  if (alien == nullptr) throw InputError("region", "landmark", "only the shape alien has landmarks");
  const AlienLandmarks marks = makeAlien({alien->height, alien->resolution}).landmarks;
  const std::map<std::string, Vec3> places{{"head", marks.head},           {"trunk", marks.trunk},
                                           {"left_hand", marks.left_hand}, {"right_hand", marks.right_hand},
                                           {"left_foot", marks.left_foot}, {"right_foot", marks.right_foot}};
  const auto at = places.find(landmark->landmark);
  if (at == places.end()) throw InputError("region", "landmark", "there is no " + landmark->landmark);
  return SphereRegionConfig{at->second, landmark->radius};
}

bool contains(const RegionConfig& region, const Vec3& point) {
  return std::visit([&](const auto& r) { return inside(r, point); }, region);
}

std::vector<int> materialPartsOf(const BodyConfig& body, const std::vector<Vec3>& points) {
  std::vector<int> parts(points.size(), -1);
  for (std::size_t part = 0; part < body.material.parts.size(); ++part) {
    const RegionConfig region = resolvedRegion(body.material.parts[part].region, body.shape);
    bool empty = true;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!contains(region, points[i])) continue;
      parts[i] = static_cast<int>(part);
      empty = false;
    }
    if (empty)
      throw InputError(body.name, fmt::format("material.parts[{}].region", part),
                       "holds no tetrahedron's centroid; make it larger or the mesh finer");
  }
  return parts;
}

}  // namespace palpate
