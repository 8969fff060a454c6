#pragma once

#include <array>
#include <vector>

#include "palpate/picture/types.h"

namespace palpate {

/// Surface of revolution about the line from `origin` along `axis` (unit).
/// @param profile  (distance along the axis, radius >= 0) [m], from one end to the other; ends of radius 0 close it
PictureMesh latheMesh(const Vec3& origin, const Vec3& axis, const std::vector<std::array<double, 2>>& profile,
                      const Color& color);

/// Sphere, or with a != b the points within `radius` of the segment from a to b.
PictureMesh capsuleMesh(const Vec3& a, const Vec3& b, double radius, const Color& color);

/// Box with square-ish facets, some ten along its longest side.
PictureMesh boxMesh(const Pose& pose, const Vec3& half_extents, const Color& color);

/// What lies on the normal's side of a plane: triangles that cross it are cut, and the cut stays open. The mesh has one
/// color.
PictureMesh cutOpen(const PictureMesh& mesh, const Vec3& point, const Vec3& normal);

/// Arrow from a to b, drawn over everything.
/// @param width  of its shaft [m]; the head is shortened for short arrows
PictureMesh arrowMesh(const Vec3& a, const Vec3& b, double width, const Color& color);

/// Pen whose tip is at `tip`, from there along `axis` (unit).
PictureMesh penMesh(const Vec3& tip, const Vec3& axis, double length, const Color& color);

}  // namespace palpate
