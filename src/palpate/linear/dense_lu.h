#pragma once

#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// LU with partial pivoting in place, right-looking in panels, which are halved; false if a pivot vanishes or is not
/// finite. Eigen's own keeps its pivots on the heap; `pivots` grows on demand.
bool luInPlace(Eigen::Ref<MatX> a, std::vector<int>& pivots);

/// Solves with what luInPlace left, in place: one right-hand side, or one in each column.
void luSolve(const Eigen::Ref<const MatX>& lu, const std::vector<int>& pivots, Eigen::Ref<VecX> x);
void luSolveColumns(const Eigen::Ref<const MatX>& lu, const std::vector<int>& pivots, Eigen::Ref<MatX> x);

}  // namespace palpate
