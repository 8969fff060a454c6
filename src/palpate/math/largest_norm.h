#pragma once

#include <algorithm>
#include <cmath>

#include "palpate/math/types.h"

namespace palpate {

/// Of the vectors of three coordinates each that a field consists of, say displacements of nodes; 0 for none.
inline double largestNorm(const VecX& field) {
  double squared = 0;
  for (Eigen::Index i = 0; i + 2 < field.size(); i += 3) {
    squared = std::max(squared, field.segment<3>(i).squaredNorm());
  }
  return std::sqrt(squared);
}

}  // namespace palpate
