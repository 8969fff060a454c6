#include "palpate/math/decompositions.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace palpate {
namespace {

using Aligned6 = Eigen::Matrix<double, 6, 6>;

}  // namespace

SymmetricEigen symmetricEigen(const MatX& a) {
  const Eigen::SelfAdjointEigenSolver<MatX> eigen(a);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

SymmetricEigen symmetricEigen(const MatX& a, const MatX& b) {
  const Eigen::LLT<MatX> factor(b);
  MatX half = factor.matrixL().solve(MatX(a.selfadjointView<Eigen::Lower>()));
  SymmetricEigen out = symmetricEigen(MatX(factor.matrixL().solve(half.transpose())));
  factor.matrixU().solveInPlace(out.vectors);
  return out;
}

MatX solveSymmetric(const MatX& a, const MatX& b) { return Eigen::LLT<MatX>(a).solve(b); }

SymmetricEigen6 symmetricEigen(const Mat6& a) noexcept {
  const Eigen::SelfAdjointEigenSolver<Aligned6> eigen(Aligned6{a});
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

bool isPositiveDefinite(const Mat6& a) noexcept { return Eigen::LLT<Aligned6>(Aligned6{a}).info() == Eigen::Success; }

Vec6 solve(const Mat6& a, const Vec6& b) noexcept { return Aligned6{a}.partialPivLu().solve(b); }

Mat6 inverse(const Mat6& a) noexcept { return Aligned6{a}.inverse(); }

Vec6 solveSymmetric(const Mat6& a, const Vec6& b) noexcept { return Eigen::LLT<Aligned6>(Aligned6{a}).solve(b); }

}  // namespace palpate
