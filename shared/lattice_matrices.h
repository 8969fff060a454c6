#pragma once

// Sparse matrices as soft bodies have them, without any body: a bar, and a trunk with thin limbs.

#include <array>
#include <cstdint>
#include <vector>

#include "palpate/linear/symmetric_block_matrix.h"

namespace palpate::test {

/// Stand-in for the system matrix of a soft body on a lattice of cells with six tetrahedra each: its pattern, positive
/// definite values of the same kind (mass plus stiffness), and the nodes that contact is likely to touch.
struct LatticeMatrix {
  SymmetricBlockMatrix matrix;
  std::vector<int> bottom;   ///< free nodes of the lowest layer
  std::vector<int> surface;  ///< free nodes on the outside
  int tetrahedra = 0;
};

/// Bar of x * y * z cells whose top layer is held (left out of the matrix).
LatticeMatrix barMatrix(int x, int y, int z, std::uint32_t seed = 1);

/// 48 cells, 288 tetrahedra: a head and a trunk two cells thick, with four limbs one cell thick. The head's top is
/// held.
LatticeMatrix thinLimbedMatrix(std::uint32_t seed = 1);

}  // namespace palpate::test
