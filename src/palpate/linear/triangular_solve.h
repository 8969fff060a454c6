#pragma once

#include "palpate/math/types.h"

namespace palpate {

/// x = L^-1 x for the lower triangle L [n x n] of `lower`, whatever is above its diagonal, and columns x [n x columns].
/// For the sizes that contact has, tens of rows and columns, where Eigen's solve spends most of its time on packing.
void solveLowerInPlace(const Eigen::Ref<const MatX>& lower, Eigen::Ref<MatX> x);
/// The same with ones on the diagonal, whatever `lower` has there.
void solveUnitLowerInPlace(const Eigen::Ref<const MatX>& lower, Eigen::Ref<MatX> x);

}  // namespace palpate
