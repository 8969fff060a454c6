#include "palpate/linear/symmetric_block_matrix.h"

#include <algorithm>
#include <cassert>

namespace palpate {

SymmetricBlockMatrix SymmetricBlockMatrix::fromPairs(int size, const std::vector<std::pair<int, int>>& pairs) {
  // (column, row) of every block in the lower triangle, so that sorting gives the storage order
  std::vector<std::pair<int, int>> entries;
  entries.reserve(pairs.size() + static_cast<std::size_t>(size));
  for (int i = 0; i < size; ++i) entries.emplace_back(i, i);
  for (const auto& [i, j] : pairs) {
    assert(i >= 0 && i < size && j >= 0 && j < size);
    entries.emplace_back(std::min(i, j), std::max(i, j));
  }
  std::sort(entries.begin(), entries.end());
  entries.erase(std::unique(entries.begin(), entries.end()), entries.end());

  SymmetricBlockMatrix matrix;
  matrix.size = size;
  matrix.column.assign(static_cast<std::size_t>(size) + 1, 0);
  matrix.row.reserve(entries.size());
  for (const auto& [j, i] : entries) {
    ++matrix.column[j + 1];
    matrix.row.push_back(i);
  }
  for (int j = 0; j < size; ++j) matrix.column[j + 1] += matrix.column[j];
  matrix.values.assign(9 * entries.size(), 0.0);
  return matrix;
}

int SymmetricBlockMatrix::find(int i, int j) const {
  if (j < 0 || i < j || i >= size) return -1;
  const auto begin = row.begin() + column[j];
  const auto end = row.begin() + column[j + 1];
  const auto found = std::lower_bound(begin, end, i);
  return found != end && *found == i ? static_cast<int>(found - row.begin()) : -1;
}

VecX SymmetricBlockMatrix::multiply(const VecX& x) const { return multiplyColumns(x); }

MatX SymmetricBlockMatrix::multiplyColumns(const MatX& x) const {
  assert(x.rows() == 3 * size);
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using Four = Eigen::Array4d;
  const Rows from = x;
  Rows to = Rows::Zero(from.rows(), from.cols());
  const Eigen::Index columns = from.cols();
  const auto add = [columns](const double* a, int down, int right, const double* p, double* q) {
    for (int i = 0; i < 3; ++i) {
      const double b0 = a[i * down], b1 = a[i * down + right], b2 = a[i * down + 2 * right];
      Eigen::Index c = 0;
      for (; c + 4 <= columns; c += 4) {
        Four::Map(q + i * columns + c) +=
            b0 * Four::Map(p + c) + b1 * Four::Map(p + columns + c) + b2 * Four::Map(p + 2 * columns + c);
      }
      for (; c < columns; ++c) {
        q[i * columns + c] += b0 * p[c] + b1 * p[columns + c] + b2 * p[2 * columns + c];
      }
    }
  };
  for (int j = 0; j < size; ++j) {
    for (int slot = column[j]; slot < column[j + 1]; ++slot) {
      const int i = row[slot];
      const double* a = values.data() + 9 * slot;
      add(a, 1, 3, from.data() + 3 * j * columns, to.data() + 3 * i * columns);
      if (i != j) add(a, 3, 1, from.data() + 3 * i * columns, to.data() + 3 * j * columns);
    }
  }
  return to;
}

VecX SymmetricBlockMatrix::diagonal() const {
  VecX out(3 * size);
  for (int j = 0; j < size; ++j) out.segment<3>(3 * j) = block(column[j]).diagonal();
  return out;
}

}  // namespace palpate
