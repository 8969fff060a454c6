#pragma once

#include <vector>

#include "palpate/mesh/piece_mesh.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Which piece of solid lies under a place of the surface.
class PieceLocator {
 public:
  PieceLocator(const BccLattice& lattice, const TetrahedronSubdivision& cut, const PieceMesh& pieces)
      : lattice_(lattice), cut_(cut), pieces_(pieces) {}

  /// The piece whose sample holds x, or -1.
  int at(const Vec3& x) const;
  /// The piece just under a point of the surface; -1 if no sample near it lies inside. normal: outward, unit length.
  int under(const Vec3& x, const Vec3& normal) const;

 private:
  const BccLattice& lattice_;
  const TetrahedronSubdivision& cut_;
  const PieceMesh& pieces_;
};

/// Places where the surface is whole and the mesh under it is not: neighboring points of the surface, at most half a
/// cell apart, whose tetrahedra no short way through faces connects. There an edge would open under load.
struct Seams {
  int count = 0;
  std::vector<Vec3> bridges;  ///< points of the surface; with their samples solid, the seams are closed
};

/// @param spacing  of the bridges [m]: below the size of a sample
Seams findSeams(const Surface& surface, const BccLattice& lattice, const TetrahedronSubdivision& cut, PieceMesh& pieces,
                double spacing);

}  // namespace palpate
