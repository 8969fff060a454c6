#pragma once

#include <string>

#include "palpate/mesh/surface_measures.h"
#include "palpate/mesh/types.h"

namespace palpate {

struct RepairOptions {
  double weld_tolerance = 1e-6;  ///< vertices nearer than this times the bounding box's diagonal become one
};

struct RepairReport {
  int welded_vertices = 0;
  int unused_vertices = 0;
  int degenerate_triangles = 0;  ///< dropped: two equal corners, or no area
  int duplicate_triangles = 0;   ///< dropped: same three vertices as an earlier one; both, where two solids touch
  int flipped_triangles = 0;     ///< turned to agree with their neighbors or to face outward
  SurfaceTopology topology;      ///< of the result
};

struct RepairedSurface {
  Surface surface;
  RepairReport report;
  /// For each vertex given, its vertex in the result, -1 if no triangle uses it.
  std::vector<int> vertex_map;
};

/// Welds vertices, drops degenerate and duplicate triangles and those in which two solids touch, makes the orientation
/// of each connected patch consistent (the majority by area decides) and outward (a patch facing inward stays so only
/// inside another patch: a cavity).
RepairedSurface repairSurface(const Surface& surface, const RepairOptions& options = {});

/// Throws InputError(name, "", cause) unless the surface bounds a volume: finite, some triangles, caps of holes at most
/// 35 % of the area, and a positive volume. Expects a repaired surface.
void requireSolid(const Surface& surface, const std::string& name);

}  // namespace palpate
