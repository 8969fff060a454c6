#pragma once

#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

struct TetrahedraQuality {
  double smallest_dihedral_deg = 0;
  double largest_dihedral_deg = 0;
  double worst_radius_ratio = 0;  ///< 3 inradius / circumradius, 1 for a regular tetrahedron, 0 for a flat one
  double smallest_volume = 0;     ///< [m^3]
  int components = 0;             ///< connected by nodes
  int face_components = 0;        ///< connected through faces; more than by nodes: parts hinge on edges or single nodes
};
TetrahedraQuality measureQuality(const TetrahedralMesh& mesh);

struct TriangleQuality {
  double smallest_angle_deg = 0;
  double largest_angle_deg = 0;
  double shortest_edge = 0;  ///< [m]
  double longest_edge = 0;   ///< [m]
};
TriangleQuality measureQuality(const Surface& surface);

/// Volume of a tetrahedron of the mesh [m^3], signed.
double tetrahedronVolume(const TetrahedralMesh& mesh, const std::array<int, 4>& tetrahedron);
/// Share of each tetrahedron's volume by which it resists: its fill, at least a fifth of what the fullest tetrahedron
/// at one of its nodes has. What is next to empty then holds the surface in it, and a node of its own; where all are
/// filled by little, as in a needle that is thinner than the lattice, they resist by what is there.
std::vector<double> resistingShares(const SimulationMesh& mesh);
/// Not of positive volume, or not finite, with its nodes at these positions, x y z of each [m].
bool isTurnedOver(const std::array<int, 4>& tetrahedron, const VecX& positions);

}  // namespace palpate
