#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/math/types.h"

namespace palpate {

/// |v| without overflow or underflow on the way. Eigen's stableNorm() does the same but splits the sum where the
/// address becomes a multiple of 32, so that its last digit depends on where the stack happens to be.
inline double stableNorm(const Vec3& v) {
  const double largest = v.cwiseAbs().maxCoeff();
  if (!(largest > 0) || std::isinf(largest)) return largest;
  const double scale = std::max(largest, std::numeric_limits<double>::min()), inverse = 1 / scale;
  const double x = v.x() * inverse, y = v.y() * inverse, z = v.z() * inverse;
  return scale * std::sqrt(x * x + y * y + z * z);
}

}  // namespace palpate
