#pragma once

#include <functional>

#include "palpate/linear/symmetric_block_matrix.h"
#include "palpate/math/types.h"

namespace palpate {

/// K against M, known by what A = s M + e K does.
struct ModalProblem {
  Eigen::Index rows;
  double s, e;                                ///< of A; [1], [s^2]
  std::function<void(MatX&)> solve;           ///< columns <- A^-1 columns
  std::function<MatX(const MatX&)> momentum;  ///< M columns
  const SymmetricBlockMatrix* matrix;         ///< A; null: sought anew in any case
};

/// Lowest modes.
struct Modes {
  MatX shapes;             ///< [rows x r], mass-normalized
  VecX squared_frequency;  ///< [1/s^2], increasing
};

/// What modes were made of; projects later states of the same body on them.
struct ModalBasis {
  MatX modes;   ///< mass-normalized, [rows x r]
  VecX places;  ///< where they were made, corrections included [m]

  /// Q^T M of a field on the free nodes.
  VecX project(const VecX& mass, const VecX& field) const { return modes.transpose() * mass.cwiseProduct(field); }
};

/// By subspace iteration; where the start still is an invariant subspace but for little, its Ritz vectors.
/// @param start   modes of another problem that is hardly different, [rows x any], mass-normalized; or empty: chosen
///                here, with more sweeps
/// @param count   r; fewer where there are fewer rows
Modes findModes(const ModalProblem& problem, const MatX& start, int count);

}  // namespace palpate
