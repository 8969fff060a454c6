#pragma once

#include "palpate/math/types.h"

namespace palpate {

/// L with L L^T = a in the lower triangle of a, in place; what is above the diagonal is neither read nor kept. False if
/// a pivot is not positive. Blocks of the trailing matrix are parts of a parallelFor().
bool choleskyInPlace(Eigen::Ref<MatX> a);

}  // namespace palpate
