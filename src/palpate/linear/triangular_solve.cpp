#include "palpate/linear/triangular_solve.h"

#include <algorithm>

namespace palpate {
namespace {

constexpr Eigen::Index kVector = 8;
constexpr Eigen::Index kSolveLeaf = 48;  // rows that are eliminated one by one; more are halved
constexpr Eigen::Index kColumns = 4;

using Vector = Eigen::Array<double, kVector, 1>;
using Block = Eigen::Map<Vector, Eigen::Aligned64>;
using ConstBlock = Eigen::Map<const Vector, Eigen::Aligned64>;

/// Columns of L in whole vectors, with zeros above and on the diagonal, whose inverses are apart.
struct Leaf {
  alignas(64) double columns[kSolveLeaf * kSolveLeaf];
  double inverse[kSolveLeaf];
  Eigen::Index rows, blocks;

  Leaf(const Eigen::Ref<const MatX>& lower, bool unit)
      : rows(lower.rows()), blocks((lower.rows() + kVector - 1) / kVector) {
    for (Eigen::Index k = 0; k < rows; ++k) {
      double* to = columns + k * kSolveLeaf;
      const double* from = lower.col(k).data();
      std::fill(to + k / kVector * kVector, to + k + 1, 0.0);
      std::copy(from + k + 1, from + rows, to + k + 1);
      std::fill(to + rows, to + blocks * kVector, 0.0);
      inverse[k] = unit ? 1.0 : 1.0 / from[k];
    }
  }

  template <int Count>
  void solve(double* x) const {
    for (Eigen::Index k = 0; k < rows; ++k) {
      double factor[Count];
      for (int c = 0; c < Count; ++c) factor[c] = x[c * kSolveLeaf + k] *= inverse[k];
      const double* column = columns + k * kSolveLeaf;
      for (Eigen::Index b = (k + 1) / kVector; b < blocks; ++b) {
        const Vector l = ConstBlock(column + b * kVector);
        for (int c = 0; c < Count; ++c) Block(x + c * kSolveLeaf + b * kVector) -= factor[c] * l;
      }
    }
  }
};

void solveLeaf(const Eigen::Ref<const MatX>& lower, Eigen::Ref<MatX>& x, Eigen::Index first, bool unit) {
  const Leaf leaf(lower, unit);
  alignas(64) double part[kColumns * kSolveLeaf];
  std::fill(part, part + kColumns * kSolveLeaf, 0.0);
  for (Eigen::Index j = 0; j < x.cols(); j += kColumns) {
    const Eigen::Index count = std::min(kColumns, x.cols() - j);
    for (Eigen::Index c = 0; c < count; ++c) {
      const double* from = x.col(j + c).data() + first;
      std::copy(from, from + leaf.rows, part + c * kSolveLeaf);
    }
    leaf.solve<kColumns>(part);
    for (Eigen::Index c = 0; c < count; ++c) {
      std::copy(part + c * kSolveLeaf, part + c * kSolveLeaf + leaf.rows, x.col(j + c).data() + first);
    }
  }
}

void solveRows(const Eigen::Ref<const MatX>& lower, Eigen::Ref<MatX>& x, Eigen::Index first, Eigen::Index count,
               bool unit) {
  if (count <= kSolveLeaf) {
    solveLeaf(lower.block(first, first, count, count), x, first, unit);
    return;
  }
  const Eigen::Index half = (count / 2 + kVector - 1) / kVector * kVector;
  solveRows(lower, x, first, half, unit);
  x.middleRows(first + half, count - half).noalias() -=
      lower.block(first + half, first, count - half, half) * x.middleRows(first, half);
  solveRows(lower, x, first + half, count - half, unit);
}

}  // namespace

void solveLowerInPlace(const Eigen::Ref<const MatX>& lower, Eigen::Ref<MatX> x) {
  if (lower.rows() > 0) solveRows(lower, x, 0, lower.rows(), false);
}

void solveUnitLowerInPlace(const Eigen::Ref<const MatX>& lower, Eigen::Ref<MatX> x) {
  if (lower.rows() > 0) solveRows(lower, x, 0, lower.rows(), true);
}

}  // namespace palpate
