#pragma once

#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// LU with partial pivoting in place, right-looking in panels; false if a pivot vanishes or is not finite. Eigen's own
/// keeps its pivots on the heap; `pivots` grows on demand.
bool luInPlace(Eigen::Ref<MatX> a, std::vector<int>& pivots);

/// Solves with what luInPlace left, in place.
void luSolve(const Eigen::Ref<const MatX>& lu, const std::vector<int>& pivots, Eigen::Ref<VecX> x);

}  // namespace palpate
