#pragma once

// The scanned bunny of Debian's package glmark2-data: where it is, and as a soft body that stands on the ground.

#include <algorithm>

#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/surface_io.h"

namespace palpate::test {

inline const char* const kBunnyFile = "/usr/share/glmark2/models/bunny.obj";

/// Upright, its longest side 0.1 m, its lowest vertex at z = 0.
inline SimulationMesh standingBunny(int tetrahedra) {
  Surface surface = loadSolid(kBunnyFile, 0.1);
  double lowest = 1e300;
  for (Vec3& p : surface.vertices) {
    p = Vec3(p.x(), -p.z(), p.y());  // the scan's y is up
    lowest = std::min(lowest, p.z());
  }
  for (Vec3& p : surface.vertices) p.z() -= lowest;
  EmbedOptions options;
  options.target_tetrahedra = tetrahedra;
  return embedSurface(surface, options);
}

}  // namespace palpate::test
