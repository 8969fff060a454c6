#pragma once

#include <algorithm>

#include "palpate/math/types.h"

namespace palpate {

/// Parameter in [0, 1] of the point of segment ab that is closest to p; 0 for a segment without length.
inline double closestOnSegment(const Vec3& p, const Vec3& a, const Vec3& b) {
  const Vec3 d = b - a;
  const double length2 = d.squaredNorm();
  if (!(length2 > 0)) return 0;
  return std::clamp(d.dot(p - a) / length2, 0.0, 1.0);
}

}  // namespace palpate
