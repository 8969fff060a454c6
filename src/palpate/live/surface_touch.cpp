#include "palpate/live/surface_touch.h"

#include <algorithm>

#include "palpate/math/segment.h"

namespace palpate {
namespace {

constexpr double kLeastBend = 0.5;     // [1/m]: what is less round than that has no nearest place
constexpr double kLeastAcross = 0.09;  // squared sine of the angle to a capsule's axis

// By how far a line through x comes nearer to the surface along its direction, to where it is nearest.
double wayToNearest(const LiveSurface& surface, const Vec3& x, const Vec3& direction) {
  if (surface.kind == LiveSurface::Kind::plane) {
    const Vec3 turn = surface.bend * direction;
    const double bend = direction.dot(turn);
    if (!(bend > kLeastBend)) return 0;
    return -(surface.normal.dot(direction) + turn.dot(x - surface.a)) / bend;
  }
  const Vec3 axis = surface.b - surface.a;
  const double share = closestOnSegment(x, surface.a, surface.b);
  Vec3 across = direction;
  if (share > 0 && share < 1) across -= axis.dot(direction) / axis.squaredNorm() * axis;
  if (!(across.squaredNorm() > kLeastAcross)) return 0;
  return across.dot(surface.a + share * axis - x) / across.squaredNorm();
}

}  // namespace

SurfaceTouch touch(const LiveSurface& surface, const Vec3& place) noexcept {
  if (surface.kind == LiveSurface::Kind::plane) {
    const Vec3 d = place - surface.a, turn = surface.bend * d;
    const double height = surface.normal.dot(d) - surface.offset, size = turn.norm();
    if (!(size > 0)) return {height, surface.normal};
    // straight on from where the normal has turned far enough: of its height this is the derivative, of which the
    // length makes a distance
    const double share = std::min(1.0, LiveSurface::kMostTurn / size);
    const Vec3 normal = surface.normal + share * turn;
    const double length = normal.norm();
    return {(height + share * (1.0 - 0.5 * share) * d.dot(turn)) / length, normal / length};
  }
  const Vec3 out = place - (surface.a + closestOnSegment(place, surface.a, surface.b) * (surface.b - surface.a));
  const double distance = out.norm();
  const Vec3 normal = distance > 1e-9 ? Vec3(out / distance) : surface.normal;
  return {distance - surface.offset, normal};
}

Vec3 slideAlongFlat(const LiveSurface& surface, const Mat3& rotation, const Vec3& place) noexcept {
  Vec3 way = Vec3::Zero();
  for (int k = 0; k < surface.flat_directions; ++k) {
    const LiveSurface::Flat& flat = surface.flat[static_cast<std::size_t>(k)];
    const double s = wayToNearest(surface, place + rotation * way, rotation * flat.direction);
    way += std::clamp(s, flat.least, flat.greatest) * flat.direction;
  }
  return way;
}

}  // namespace palpate
