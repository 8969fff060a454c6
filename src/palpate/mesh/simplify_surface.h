#pragma once

#include "palpate/mesh/types.h"

namespace palpate {

struct SimplifiedSurface {
  Surface surface;
  double deviation = 0;  ///< [m] as farthestApart(), from the surface that was simplified; 0 where nothing was left out
};

/// The same shape in fewer triangles: a scan has many more of them than its simulation can tell apart, and search for
/// contact pays for each pair that is near. Edges are collapsed to one of their ends, those of least quadric error
/// first (Garland and Heckbert 1997), as long as
/// - each vertex that was left out is within `tolerance` [m] of the triangles that took its place;
/// - no triangle turns over or becomes a needle, and the surface stays as sound as it was (link condition);
/// - a vertex at a hole, or where more than two triangles meet at an edge, stays.
/// If the whole is farther from the surface than `tolerance` somewhere, or passes through itself where the surface does
/// not, less is left out. The surface stays as it is if that leaves out less than a fifth of its triangles, or if
/// `tolerance` is not positive; more than 1 % of its bounding box's diagonal counts as that. The result's vertices are
/// some of the surface's, in their order. Expects a repaired surface.
SimplifiedSurface simplifySurface(const Surface& surface, double tolerance);

/// Farthest that a vertex of either surface, or the middle of an edge or a triangle of the second, is from the other
/// [m]; infinite beyond `reach`.
double farthestApart(const Surface& first, const Surface& second, double reach);

}  // namespace palpate
