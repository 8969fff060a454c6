#pragma once

#include <array>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Triangle surface. Triangles are counter-clockwise seen from outside once the surface has been oriented.
struct Surface {
  std::vector<Vec3> vertices;                 ///< [m]
  std::vector<std::array<int, 3>> triangles;  ///< indices into vertices
};

/// Tetrahedral mesh; det(x1 - x0, x2 - x0, x3 - x0) > 0 for every tetrahedron.
struct TetrahedralMesh {
  std::vector<Vec3> nodes;                     ///< [m]
  std::vector<std::array<int, 4>> tetrahedra;  ///< indices into nodes
};

/// A surface point in the simulation mesh: x = sum_k weights[k] * node(tetrahedra[tetrahedron][k]).
struct EmbeddedPoint {
  int tetrahedron = -1;
  std::array<double, 4>
      weights{};  ///< barycentric, sum 1; may be slightly negative where the mesh does not cover the point
};

/// What the simulation needs of a body: a coarse tetrahedral mesh with a fine surface embedded in it.
struct SimulationMesh {
  TetrahedralMesh mesh;
  /// Fraction of each tetrahedron that lies inside the surface, in (0, 1]; scales mass and, see resistingShares(),
  /// stiffness.
  std::vector<double> fill;
  /// Integral of node k's shape function over the filled part, divided by the tetrahedron's volume: >= 0, sums to fill.
  /// density * volume * share[k] is the mass that tetrahedron gives its k-th node, so total mass is density times the
  /// surface's volume and the centre of mass is the surface's.
  std::vector<std::array<double, 4>> share;
  Surface surface;
  std::vector<EmbeddedPoint> embedding;  ///< one a surface vertex
};

}  // namespace palpate
