#pragma once

#include "palpate/linear/symmetric_block_matrix.h"

namespace palpate::bench {

/// What one numeric factorization costs in general-purpose libraries, on one thread, symbolic analysis not counted.
struct FactorizationBaseline {
  double eigen_llt_us = 0.0;   ///< Eigen::SimplicialLLT, AMD ordering
  double eigen_ldlt_us = 0.0;  ///< Eigen::SimplicialLDLT, AMD ordering
  double cholmod_us = 0.0;     ///< CHOLMOD, the better of simplicial and supernodal with the ordering of its own choice

  double fastest() const;
};

/// Median over `repetitions` of each. The matrix is handed to the libraries as a scalar sparse matrix, ready made.
FactorizationBaseline measureFactorizationBaseline(const SymmetricBlockMatrix& matrix, int repetitions = 50);

}  // namespace palpate::bench
