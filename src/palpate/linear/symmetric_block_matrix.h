#pragma once

#include <array>
#include <utility>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Symmetric matrix of 3x3 blocks on a fixed pattern: the lower triangle (row >= column) by columns, the diagonal first
/// in each column. Built once; `values` is refilled every step.
struct SymmetricBlockMatrix {
  int size = 0;                ///< number of block rows (nodes)
  std::vector<int> column;     ///< [size + 1] first slot of each block column
  std::vector<int> row;        ///< [slots] block row of each slot, ascending within a column
  std::vector<double> values;  ///< [9 * slots] each block column-major; diagonal blocks hold all nine entries

  int slots() const { return static_cast<int>(row.size()); }
  Eigen::Map<Mat3> block(int slot) { return Eigen::Map<Mat3>(values.data() + 9 * slot); }
  Eigen::Map<const Mat3> block(int slot) const { return Eigen::Map<const Mat3>(values.data() + 9 * slot); }

  /// Pattern from pairs of coupled nodes in [0, size); diagonals are always present, duplicates and order do not
  /// matter.
  static SymmetricBlockMatrix fromPairs(int size, const std::vector<std::pair<int, int>>& pairs);
  /// Slot of block (i, j), i >= j; -1 if the pattern has none.
  int find(int i, int j) const;
  /// y = A x for dense x [3 size]; used by checks.
  VecX multiply(const VecX& x) const;
  /// The same of columns, [3 size x any].
  MatX multiplyColumns(const MatX& x) const;
  /// [3 size]
  VecX diagonal() const;
};

}  // namespace palpate
