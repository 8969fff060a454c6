#include "palpate/live/tick_algebra.h"

#include <cmath>

namespace palpate {
namespace {

constexpr int kStride = LiveSize::kUnknowns;

// Rows [row, row + kTall) and columns [column, column + 3) of g += scale x x^T, summed up in registers.
template <int kTall>
void addGramTile(double scale, const TickMatrix& x, Eigen::Index row, Eigen::Index column, TickCompliance& g) {
  double sum[3][kTall];
  double* const out = g.data() + column * g.rows() + row;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < kTall; ++i) sum[j][i] = out[j * g.rows() + i];
  for (Eigen::Index c = 0; c < x.columns; ++c) {
    const double* const entries = x.data + c * x.stride;
    for (int j = 0; j < 3; ++j) {
      const double factor = scale * entries[column + j];
      for (int i = 0; i < kTall; ++i) sum[j][i] += factor * entries[row + i];
    }
  }
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < kTall; ++i) out[j * g.rows() + i] = sum[j][i];
}

}  // namespace

void addProduct(double scale, const TickMatrix& a, const double* x, double* y) noexcept {
  Eigen::Index c = 0;
  for (; c + 1 < a.columns; c += 2) {
    const double* const first = a.data + c * a.stride;
    const double* const second = first + a.stride;
    const double f = scale * x[c], g = scale * x[c + 1];
    for (Eigen::Index i = 0; i < a.rows; ++i) y[i] += f * first[i] + g * second[i];
  }
  if (c == a.columns) return;
  const double* const last = a.data + c * a.stride;
  const double f = scale * x[c];
  for (Eigen::Index i = 0; i < a.rows; ++i) y[i] += f * last[i];
}

void addTransposed(double scale, const TickMatrix& a, const double* x, double* y) noexcept {
  for (Eigen::Index c = 0; c < a.columns; ++c) {
    const double* const column = a.data + c * a.stride;
    double even = 0, odd = 0;
    Eigen::Index i = 0;
    for (; i + 1 < a.rows; i += 2) {
      even += column[i] * x[i];
      odd += column[i + 1] * x[i + 1];
    }
    if (i < a.rows) even += column[i] * x[i];
    y[c] += scale * (even + odd);
  }
}

void TickCholesky::factor(const Matrix& a, int coupled) noexcept {
  size_ = static_cast<int>(a.rows());
  coupled_ = coupled;
  for (int i = 0; i < size_; ++i) {
    double* const row = l_.data() + i * kStride;
    for (int j = first(i); j <= i; ++j) {
      const double* const other = l_.data() + j * kStride;
      double sum = a(i, j);
      for (int k = first(j); k < j; ++k) sum -= row[k] * other[k];
      row[j] = j < i ? sum * other[j] : 1.0 / std::sqrt(sum);
    }
  }
}

void TickCholesky::solve(TickUnknowns& b) const noexcept {
  for (int i = 0; i < size_; ++i) {
    const double* const row = l_.data() + i * kStride;
    double sum = b[i];
    for (int k = first(i); k < i; ++k) sum -= row[k] * b[k];
    b[i] = sum * row[i];
  }
  solveUpper(b);
}

void TickCholesky::solveUpper(TickUnknowns& b) const noexcept {
  for (int i = size_ - 1; i >= 0; --i) {
    const double* const row = l_.data() + i * kStride;
    b[i] *= row[i];
    for (int k = first(i); k < i; ++k) b[k] -= row[k] * b[i];
  }
}

void TickCholesky::solveLower(TickRows& x) const noexcept {
  const Eigen::Index rows = x.rows();
  for (int i = 0; i < size_; ++i) {
    const double* const row = l_.data() + i * kStride;
    double* const own = x.data() + i * rows;
    for (int k = first(i); k < i; ++k) {
      const double* const other = x.data() + k * rows;
      for (Eigen::Index r = 0; r < rows; ++r) own[r] -= row[k] * other[r];
    }
    for (Eigen::Index r = 0; r < rows; ++r) own[r] *= row[i];
  }
}

void addGram(double scale, const TickMatrix& x, TickCompliance& g) noexcept {
  constexpr int kTall = 12;  // with three columns, as many sums as registers of four hold
  for (Eigen::Index column = 0; column < x.rows; column += 3) {
    Eigen::Index row = column;
    for (; row + kTall <= x.rows; row += kTall) addGramTile<kTall>(scale, x, row, column, g);
    for (; row < x.rows; row += 3) addGramTile<3>(scale, x, row, column, g);
    for (int j = 0; j < 3; ++j)
      for (row = column + j + 1; row < x.rows; ++row) g(column + j, row) = g(row, column + j);
  }
}

}  // namespace palpate
