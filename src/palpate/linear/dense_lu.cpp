#include "palpate/linear/dense_lu.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/common/parallel.h"
#include "palpate/linear/triangular_solve.h"

namespace palpate {

namespace {

using Matrix = Eigen::Ref<MatX>;

constexpr Eigen::Index kSmall = 48;  // rows up to which calls of matrix products cost more than they save
constexpr Eigen::Index kLeaf = 8;    // columns that are eliminated one by one
constexpr Eigen::Index kPanel = 96;  // and those that are halved down to leaves
constexpr Eigen::Index kPartRows = 128;

/// Row exchanges of the pivots [first, end) in the columns [from, to), column by column as they lie in memory.
void exchangeRows(Matrix& a, const std::vector<int>& pivots, Eigen::Index first, Eigen::Index end, Eigen::Index from,
                  Eigen::Index to) {
  for (Eigen::Index j = from; j < to; ++j) {
    double* column = &a(0, j);
    for (Eigen::Index k = first; k < end; ++k) std::swap(column[k], column[pivots[static_cast<std::size_t>(k)]]);
  }
}

/// a -= factor b, for columns of which few are long.
void subtractColumn(double* a, const double* b, double factor, Eigen::Index size) {
  for (Eigen::Index i = 0; i < size; ++i) a[i] -= factor * b[i];
}

/// In a copy whose columns begin on vectors' borders, with multipliers of zero above the diagonal: all updates are of
/// whole vectors then.
bool factorizeSmall(Matrix& a, std::vector<int>& pivots) {
  constexpr Eigen::Index kVector = 8;
  using Vector = Eigen::Array<double, kVector, 1>;
  alignas(64) double copy[kSmall * kSmall], multipliers[kSmall];
  const Eigen::Index n = a.rows(), blocks = (n + kVector - 1) / kVector, stride = blocks * kVector;
  for (Eigen::Index j = 0; j < n; ++j) {
    std::copy(a.col(j).data(), a.col(j).data() + n, copy + j * stride);
    std::fill(copy + j * stride + n, copy + (j + 1) * stride, 0.0);
  }
  std::fill(multipliers, multipliers + stride, 0.0);
  for (Eigen::Index k = 0; k < n; ++k) {
    double* column = copy + k * stride;
    Eigen::Index p = k;
    double largest = std::abs(column[k]);
    for (Eigen::Index i = k + 1; i < n; ++i) {
      const double size = std::abs(column[i]);
      if (size > largest) {
        largest = size;
        p = i;
      }
    }
    pivots[static_cast<std::size_t>(k)] = static_cast<int>(p);
    if (!(largest > 0.0) || !std::isfinite(column[p])) return false;
    if (p != k) {
      for (double* entry = copy; entry < copy + n * stride; entry += stride) std::swap(entry[k], entry[p]);
    }
    const double inverse = 1.0 / column[k];
    multipliers[k] = 0.0;
    for (Eigen::Index i = k + 1; i < n; ++i) multipliers[i] = column[i] *= inverse;
    for (Eigen::Index j = k + 1; j < n; ++j) {
      double* to = copy + j * stride;
      const double factor = to[k];
      for (Eigen::Index b = (k + 1) / kVector; b < blocks; ++b) {
        Eigen::Map<Vector, Eigen::Aligned64>(to + b * kVector) -=
            factor * Eigen::Map<const Vector, Eigen::Aligned64>(multipliers + b * kVector);
      }
    }
  }
  for (Eigen::Index j = 0; j < n; ++j) std::copy(copy + j * stride, copy + j * stride + n, a.col(j).data());
  return true;
}

/// Rows [first, end) and below of the columns from `from` to `to`, once columns [first, end) are factorized.
void eliminate(Matrix& a, Eigen::Index first, Eigen::Index end, Eigen::Index from, Eigen::Index to) {
  const Eigen::Index width = end - first, below = a.rows() - end, columns = to - from;
  solveUnitLowerInPlace(a.block(first, first, width, width), a.block(first, from, width, columns));
  a.block(end, from, below, columns).noalias() -=
      a.block(end, first, below, width) * a.block(first, from, width, columns);
}

/// Factor of the columns [first, end) from row `first` on, by halves; exchanges rows in these columns only.
bool factorizeColumns(Matrix& a, Eigen::Index first, Eigen::Index end, std::vector<int>& pivots) {
  const Eigen::Index n = a.rows();
  if (end - first > kLeaf) {
    const Eigen::Index middle = first + (end - first) / 2;
    if (!factorizeColumns(a, first, middle, pivots)) return false;
    exchangeRows(a, pivots, first, middle, middle, end);
    eliminate(a, first, middle, middle, end);
    if (!factorizeColumns(a, middle, end, pivots)) return false;
    exchangeRows(a, pivots, middle, end, first, middle);
    return true;
  }
  for (Eigen::Index k = first; k < end; ++k) {
    Eigen::Index p = 0;
    const double pivot = a.col(k).tail(n - k).cwiseAbs().maxCoeff(&p);
    p += k;
    pivots[static_cast<std::size_t>(k)] = static_cast<int>(p);
    if (!(pivot > 0.0) || !std::isfinite(pivot)) return false;
    if (p != k) {
      for (Eigen::Index j = first; j < end; ++j) std::swap(a(k, j), a(p, j));
    }
    a.col(k).tail(n - k - 1) /= a(k, k);
    for (Eigen::Index j = k + 1; j < end; ++j) a.col(j).tail(n - k - 1) -= a(k, j) * a.col(k).tail(n - k - 1);
  }
  return true;
}

}  // namespace

bool luInPlace(Eigen::Ref<MatX> a, std::vector<int>& pivots) {
  const Eigen::Index n = a.rows();
  if (pivots.size() < static_cast<std::size_t>(n)) pivots.resize(static_cast<std::size_t>(n));
  if (n <= kSmall) return factorizeSmall(a, pivots);
  if (!factorizeColumns(a, 0, std::min(kPanel, n), pivots)) return false;
  for (Eigen::Index first = 0; first < n; first += kPanel) {
    const Eigen::Index end = std::min(first + kPanel, n), next = std::min(end + kPanel, n);
    const int chunks = static_cast<int>((n - next + kPanel - 1) / kPanel);
    bool good = true;
    // columns that come next are factorized while the others are brought up to date; last, rows on the left
    parallelFor(chunks + 2, [&](int part) {
      const Eigen::Index from = part == 0 ? end : next + (part - 1) * kPanel;
      const Eigen::Index to = part == 0 ? next : std::min(from + kPanel, n);
      if (part == chunks + 1) {
        exchangeRows(a, pivots, first, end, 0, first);
      } else if (from < to) {
        exchangeRows(a, pivots, first, end, from, to);
        eliminate(a, first, end, from, to);
        if (part == 0) good = factorizeColumns(a, end, next, pivots);
      }
    });
    if (!good) return false;
  }
  return true;
}

void luSolve(const Eigen::Ref<const MatX>& lu, const std::vector<int>& pivots, Eigen::Ref<VecX> x) {
  const Eigen::Index n = x.size();
  for (Eigen::Index k = 0; k < n; ++k) std::swap(x[k], x[pivots[static_cast<std::size_t>(k)]]);
  if (n <= kSmall) {
    for (Eigen::Index k = 0; k < n; ++k) subtractColumn(&x[0] + k + 1, lu.col(k).data() + k + 1, x[k], n - k - 1);
    for (Eigen::Index k = n; k-- > 0;) {
      x[k] /= lu(k, k);
      subtractColumn(&x[0], lu.col(k).data(), x[k], k);
    }
    return;
  }
  // mostly a matter of reading the factor: rows that are still to come are shared out
  const auto subtract = [&](Eigen::Index row, Eigen::Index rows, Eigen::Index column, Eigen::Index columns) {
    const int parts = static_cast<int>((rows + kPartRows - 1) / kPartRows);
    parallelFor(parts, [&](int part) {
      const Eigen::Index begin = row + part * kPartRows, count = std::min(kPartRows, row + rows - begin);
      x.segment(begin, count).noalias() -= lu.block(begin, column, count, columns) * x.segment(column, columns);
    });
  };
  for (Eigen::Index k = 0; k < n; k += kPanel) {
    const Eigen::Index width = std::min(kPanel, n - k);
    auto own = x.segment(k, width);
    lu.block(k, k, width, width).triangularView<Eigen::UnitLower>().solveInPlace(own);
    subtract(k + width, n - k - width, k, width);
  }
  for (Eigen::Index k = (n - 1) / kPanel * kPanel; k >= 0; k -= kPanel) {
    const Eigen::Index width = std::min(kPanel, n - k);
    auto own = x.segment(k, width);
    lu.block(k, k, width, width).triangularView<Eigen::Upper>().solveInPlace(own);
    subtract(0, k, k, width);
  }
}

void luSolveColumns(const Eigen::Ref<const MatX>& lu, const std::vector<int>& pivots, Eigen::Ref<MatX> x) {
  exchangeRows(x, pivots, 0, x.rows(), 0, x.cols());
  lu.triangularView<Eigen::UnitLower>().solveInPlace(x);
  lu.triangularView<Eigen::Upper>().solveInPlace(x);
}

}  // namespace palpate
