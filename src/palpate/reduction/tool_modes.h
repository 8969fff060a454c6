#pragma once

#include "palpate/linear/sparse_cholesky.h"
#include "palpate/math/types.h"

namespace palpate {

/// Lowest modes of K against M, by subspace iteration with the factor of A = s M + e K.
struct ToolModes {
  MatX shapes;             ///< [rows x r], mass-normalized
  VecX squared_frequency;  ///< [1/s^2], increasing
};

/// @param factor  of A; solves in the frame of `start`
/// @param mass    of each row [kg]
/// @param start   basis to begin with, [rows x any], or empty: chosen here, with more sweeps
/// @param count   r; fewer where there are fewer rows
/// @param s, e    of A; [1], [s^2]
ToolModes findModes(SparseCholesky& factor, const VecX& mass, const MatX& start, int count, double s, double e);

}  // namespace palpate
