#pragma once

#include <cmath>

#include "palpate/math/types.h"

namespace palpate {

/// Stress of the corotational law, in the element's rotated frame [Pa].
/// @param turned  deformation gradient, its rotation taken out: R^T F
/// @param lambda, mu  Lame parameters [Pa]
inline Mat3 corotationalStress(const Mat3& turned, double lambda, double mu) {
  const Mat3 strain = 0.5 * (turned + turned.transpose()) - Mat3::Identity();
  return lambda * strain.trace() * Mat3::Identity() + 2.0 * mu * strain;
}

/// Von Mises measure of a stress, the same in every frame [Pa].
inline double vonMises(const Mat3& stress) {
  const Mat3 deviator = stress - stress.trace() / 3.0 * Mat3::Identity();
  return std::sqrt(1.5) * deviator.norm();
}

}  // namespace palpate
