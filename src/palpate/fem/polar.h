#pragma once

#include <array>

#include "palpate/math/types.h"

namespace palpate {

/// Rotation R in SO(3) that maximizes tr(R^T F): the polar rotation of F, also for inverted F (det F < 0), where it is
/// the nearest proper rotation. Newton on the rotation from the guess; where the guess is poor, by singular values.
/// @param f      deformation gradient, any finite 3x3
/// @param guess  rotation of the previous step
Mat3 polarRotation(const Mat3& f, const Mat3& guess);

/// polarRotation() of up to four at once, each to the bit that of itself alone.
/// @param rotation  the guess, and then the result
/// @param count     how many there are; the others are not read
void polarRotations(const std::array<Mat3, 4>& f, const std::array<Mat3*, 4>& rotation, int count = 4);

/// tr(S) I - S of the symmetric part S of R^T F: maps a small body-frame rotation to the change of axial(R^T F). It is
/// positive definite exactly where R is the polar rotation and depends smoothly on F.
inline Mat3 polarHessian(const Mat3& rotation, const Mat3& f) {
  const Mat3 g = rotation.transpose() * f;
  const Mat3 s = 0.5 * (g + g.transpose());
  return s.trace() * Mat3::Identity() - s;
}

}  // namespace palpate
