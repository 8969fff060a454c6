#pragma once

#include <string>

#include "palpate/mesh/types.h"

namespace palpate {

/// Closed, outward-oriented triangle surfaces. Lengths in m; all throw InputError for sizes that are not positive.
/// Box centered at the origin, its faces divided into cells[0] x cells[1] x cells[2] squares of two triangles.
Surface boxSurface(const Vec3& size, const std::array<int, 3>& cells = {1, 1, 1});
/// Sphere about the origin: an octahedron subdivided `levels` times (8 * 4^levels triangles), volume below the
/// sphere's.
Surface sphereSurface(double radius, int levels = 4);
/// Capsule along z about the origin: radius and length of the straight part; `segments` around (multiple of 4).
Surface capsuleSurface(double radius, double length, int segments = 32);

/// Simulation mesh of a given tetrahedral mesh: completely filled, its boundary as surface, vertices embedded at nodes.
/// Throws InputError(name, ...) for an empty mesh, bad indices, or tetrahedra without volume; turns inverted ones.
SimulationMesh simulationMeshOf(TetrahedralMesh mesh, const std::string& name = "mesh");

/// Boundary triangles of a tetrahedral mesh, outward, with the node of each of its vertices.
struct BoundarySurface {
  Surface surface;
  std::vector<int> nodes;  ///< one a surface vertex
};
BoundarySurface boundaryOf(const TetrahedralMesh& mesh);

/// Bar [0, size] as a regular grid, six tetrahedra a cell about the same diagonal (Freudenthal), so that faces match.
/// Node (i, j, k) has index i + (cells[0] + 1) * (j + (cells[1] + 1) * k). 4x4x3 cells make 288 tetrahedra.
SimulationMesh barMesh(const Vec3& size, const std::array<int, 3>& cells);

}  // namespace palpate
