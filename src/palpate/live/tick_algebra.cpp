#include "palpate/live/tick_algebra.h"

#include <cmath>

namespace palpate {
namespace {

constexpr int kStride = LiveSize::kUnknowns;

}  // namespace

void TickCholesky::factor(const Matrix& a) noexcept {
  size_ = static_cast<int>(a.rows());
  for (int i = 0; i < size_; ++i) {
    double* const row = l_.data() + i * kStride;
    for (int j = 0; j <= i; ++j) {
      const double* const other = l_.data() + j * kStride;
      double sum = a(i, j);
      for (int k = 0; k < j; ++k) sum -= row[k] * other[k];
      row[j] = j < i ? sum * other[j] : 1.0 / std::sqrt(sum);
    }
  }
}

void TickCholesky::solve(TickUnknowns& b) const noexcept {
  for (int i = 0; i < size_; ++i) {
    const double* const row = l_.data() + i * kStride;
    double sum = b[i];
    for (int k = 0; k < i; ++k) sum -= row[k] * b[k];
    b[i] = sum * row[i];
  }
  solveUpper(b);
}

void TickCholesky::solveUpper(TickUnknowns& b) const noexcept {
  for (int i = size_ - 1; i >= 0; --i) {
    const double* const row = l_.data() + i * kStride;
    b[i] *= row[i];
    for (int k = 0; k < i; ++k) b[k] -= row[k] * b[i];
  }
}

void TickCholesky::solveLower(TickRows& x) const noexcept {
  const Eigen::Index rows = x.rows();
  for (int i = 0; i < size_; ++i) {
    const double* const row = l_.data() + i * kStride;
    double* const own = x.data() + i * rows;
    for (int k = 0; k < i; ++k) {
      const double* const other = x.data() + k * rows;
      for (Eigen::Index r = 0; r < rows; ++r) own[r] -= row[k] * other[r];
    }
    for (Eigen::Index r = 0; r < rows; ++r) own[r] *= row[i];
  }
}

}  // namespace palpate
