#include "palpate/reduction/flat_tool.h"

#include <algorithm>
#include <optional>

#include "palpate/contact/flat_piece.h"
#include "palpate/live/surface_touch.h"
#include "palpate/math/decompositions.h"

namespace palpate {
namespace {

constexpr double kSharpRadius = 2e-3;  // [m]: what an edge or a corner counts as
constexpr double kCrease = 0.996;      // cosine of normals between which there is an edge
constexpr double kFacing = 0.5;        // cosine to the contact's normal, beyond which a face does not touch
constexpr double kLeastBend = 5;       // [1/m]: what is less round is flat
constexpr double kMostSag = 2.5e-3;    // of a radius: how far the triangles of what is round lie inside it
constexpr double kAcross = 0.3;        // sine to a capsule's axis, above which an edge lies across it

// Its direction, where a feature is an edge between faces that are not one.
std::optional<Vec3> creaseOf(const SurfaceFeature& feature) {
  if (feature.corners.size() != 2 || feature.triangles.size() != 2) return std::nullopt;
  const Vec3 first = normalAtStart(*feature.surface, feature.triangles[0]);
  if (first.dot(normalAtStart(*feature.surface, feature.triangles[1])) > kCrease) return std::nullopt;
  return (feature.corners[1] - feature.corners[0]).normalized();
}

// An edge or a corner none of whose faces faces as the contact does.
bool isSharp(const SurfaceFeature& feature, const Vec3& normal) {
  return feature.surface != nullptr && feature.corners.size() < 3 &&
         std::none_of(feature.triangles.begin(), feature.triangles.end(),
                      [&](int t) { return normalAtStart(*feature.surface, t).dot(normal) > kCrease; });
}

double radiusOf(const Obstacle* obstacle) {
  if (obstacle == nullptr) return 0;
  if (const auto* sphere = std::get_if<SphereShape>(&obstacle->shape)) return sphere->radius;
  if (const auto* capsule = std::get_if<CapsuleShape>(&obstacle->shape)) return capsule->radius;
  return 0;
}

bool isRigid(const BodyModel& tool, const ContactPoint& point) {
  for (int k = 0; k < point.count; ++k) {
    if (tool.row()[point.node[k]] >= 0) return false;
  }
  return true;
}

// Along which lines on the tool the place moves: across what is round. World, unit, square to each other.
std::vector<Vec3> directionsOn(const FlatPiece& piece, const std::optional<Vec3>& edge, const LiveSurface& surface) {
  const bool face = piece.normal().dot(-surface.normal) > kFacing;
  const Vec3 axis = surface.b - surface.a;
  std::vector<Vec3> out;
  const auto addOnFace = [&](const Vec3& v) {
    const Vec3 flat = v - piece.normal().dot(v) * piece.normal();
    if (flat.norm() > kAcross) out.push_back(flat.normalized());
  };
  if (surface.kind == LiveSurface::Kind::plane) {
    if (edge && edge->dot(surface.bend * *edge) > kLeastBend) return {*edge};
    if (!face) return {};
    const SymmetricEigen bends = symmetricEigen(MatX(surface.bend));
    for (int k = 2; k > 0 && bends.values[k] > kLeastBend; --k) addOnFace(bends.vectors.col(k));
    if (out.size() == 2) out[1] = piece.normal().cross(out[0]);
  } else if (axis.isZero(0.0)) {
    if (edge) out.push_back(*edge);
    if (!face) return out;
    if (!edge) out.push_back(piece.along());
    out.push_back(piece.normal().cross(out[0]));
  } else {
    if (edge && edge->cross(axis).norm() > kAcross * axis.norm()) return {*edge};
    if (face) addOnFace(piece.normal().cross(axis.normalized()));
  }
  return out;
}

}  // namespace

void placeOnFlat(const World& world, const std::vector<TouchPoint>& points, const TouchCluster& cluster,
                 LiveSurface& surface, Vec3& place) {
  const Body tool = world.tool();
  std::vector<int> triangles;
  SurfaceFeature feature;
  const Contact& first = points[static_cast<std::size_t>(cluster.front().first)].contact;
  for (const auto& [index, weight] : cluster) {
    const Contact& contact = points[static_cast<std::size_t>(index)].contact;
    if (!isRigid(tool.model, contact.first)) return;
    feature = world.featureOn(world.toolIndex(), contact);
    if (feature.surface == nullptr) return;
    triangles.insert(triangles.end(), feature.triangles.begin(), feature.triangles.end());
  }
  const double gap = touch(surface, place).gap;
  LiveSurface out = surface;
  double radius = radiusOf(world.obstacleOf(first)), sag = kMostSag * radius;
  if (surface.kind == LiveSurface::Kind::plane && surface.bend.isZero(0.0)) {
    if (cluster.size() > 1) return;
    const SurfaceFeature on = world.featureOn(-1, first);
    if (!isSharp(on, surface.normal)) return;
    out.kind = LiveSurface::Kind::capsule;
    out.a = on.corners.front() - kSharpRadius * surface.normal;
    out.b = on.corners.back() - kSharpRadius * surface.normal;
    radius = kSharpRadius;
    sag = 0;
  }
  const std::optional<Vec3> edge = cluster.size() == 1 ? creaseOf(feature) : std::nullopt;
  const FlatPiece piece(*feature.surface, triangles, -surface.normal);
  const Mat3 rotation = tool.state.handle.pose.matrix();
  for (const Vec3& direction : directionsOn(piece, edge, out)) {
    const auto [least, greatest] = piece.extent(place, direction);
    if (!(least < greatest)) continue;
    out.flat[static_cast<std::size_t>(out.flat_directions++)] = {rotation.transpose() * direction, least, greatest};
  }
  if (out.flat_directions == 0) return;
  const Vec3 way = slideAlongFlat(out, rotation, place);
  place += rotation * way;
  for (LiveSurface::Flat& flat : out.flat) {
    flat.least -= flat.direction.dot(way);
    flat.greatest -= flat.direction.dot(way);
  }
  // The gap of what is met on the way is that of other places: where the obstacle's shape is known, so is the gap.
  out.offset += touch(out, place).gap - gap;
  if (out.kind == LiveSurface::Kind::capsule) {
    const double whole = radius + first.thickness;
    out.offset = std::clamp(out.offset, whole - sag, whole);
  }
  surface = out;
}

}  // namespace palpate
