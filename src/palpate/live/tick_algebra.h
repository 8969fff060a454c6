#pragma once

#include <array>

#include "palpate/live/live_model.h"

namespace palpate {

// The algebra of a tick: plain loops over a few dozen entries, which need neither a library's blocks nor its memory.

using TickUnknowns = BoundedVector<LiveSize::kUnknowns>;
/// A row of a contact for each row, an unknown for each column.
using TickRows = BoundedMatrix<LiveSize::kRows, LiveSize::kUnknowns>;
using TickCompliance = BoundedMatrix<LiveSize::kRows, LiveSize::kRows>;

/// A matrix by columns, or rows of one, as it lies in memory.
struct TickMatrix {
  const double* data;
  Eigen::Index rows, columns, stride;
  template <typename Matrix>
  TickMatrix(const Matrix& m)  // NOLINT(google-explicit-constructor): it stands for the matrix
      : data(m.data()), rows(m.rows()), columns(m.cols()), stride(m.outerStride()) {
    static_assert(!Matrix::IsRowMajor);
  }
};

/// y += scale A x, for as many entries of x as A has columns.
void addProduct(double scale, const TickMatrix& a, const double* x, double* y) noexcept;
/// y += scale A^T x
void addTransposed(double scale, const TickMatrix& a, const double* x, double* y) noexcept;

/// A = L L^T of a positive definite matrix; of another one all results are not finite.
class TickCholesky {
 public:
  using Matrix = BoundedMatrix<LiveSize::kUnknowns, LiveSize::kUnknowns>;
  /// Reads the lower triangle; of rows from `coupled` on, the diagonal.
  void factor(const Matrix& a, int coupled) noexcept;
  void solve(TickUnknowns& b) const noexcept;       ///< b = A^-1 b
  void solveUpper(TickUnknowns& b) const noexcept;  ///< b = L^-T b
  void solveLower(TickRows& x) const noexcept;      ///< x^T = L^-1 x^T

 private:
  int first(int row) const { return row < coupled_ ? 0 : row; }
  int size_ = 0, coupled_ = 0;
  std::array<double, LiveSize::kUnknowns * LiveSize::kUnknowns> l_{};  // by rows; the diagonal inverted
};

/// g += scale x x^T, of a symmetric g; a contact's three rows at a time.
void addGram(double scale, const TickMatrix& x, TickCompliance& g) noexcept;

}  // namespace palpate
