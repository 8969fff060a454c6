#pragma once

#include "palpate/math/stable_norm.h"
#include "palpate/math/types.h"

namespace palpate {

/// Shortens a vector to a length, its direction kept. @returns whether it was longer
inline bool cutNorm(Eigen::Ref<Vec3> value, double limit) {
  const double norm = stableNorm(value);
  if (norm <= limit) return false;
  value *= limit / norm;
  return true;
}

}  // namespace palpate
