#pragma once

#include "palpate/math/types.h"

namespace palpate {

// Small dense factorizations in plain loops: of some dozen rows, compiled in a second. Eigen's, made for large ones,
// take the compiler thirty, and in the haptic tick nothing may be allocated. What is large is factorized in linear/.

/// A = V diag(values) V^T, or with B: A V = B V diag(values), V^T B V = 1.
struct SymmetricEigen {
  VecX values;  ///< increasing
  MatX vectors;
};
/// Of a symmetric matrix; reads its lower triangle.
SymmetricEigen symmetricEigen(const MatX& a);
/// @param b  positive definite; for another one nothing is a number
SymmetricEigen symmetricEigen(const MatX& a, const MatX& b);
/// Reads the lower triangle.
bool isPositiveDefinite(const MatX& a);
/// A^-1 B for a positive definite A; not a number for another one.
MatX solveSymmetric(const MatX& a, const MatX& b);

// Of six by six; no memory is taken.
struct SymmetricEigen6 {
  Vec6 values;  ///< increasing
  Mat6 vectors;
};
SymmetricEigen6 symmetricEigen(const Mat6& a) noexcept;
bool isPositiveDefinite(const Mat6& a) noexcept;
Vec6 solve(const Mat6& a, const Vec6& b) noexcept;  ///< A^-1 b, pivots by rows
Mat6 inverse(const Mat6& a) noexcept;
Vec6 solveSymmetric(const Mat6& a, const Vec6& b) noexcept;  ///< A^-1 b, as the larger one

}  // namespace palpate
