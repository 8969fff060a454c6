#include "palpate/math/decompositions.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace palpate {
namespace {

constexpr int kMostSweeps = 40;  // of Jacobi rotations; less than ten are needed

// A square matrix by columns, somebody else's memory.
struct Square {
  double* data;
  int n;
  double& operator()(int i, int j) const { return data[i + j * n]; }
  double* column(int j) const { return data + j * n; }
};

// L of A = L L^T into the lower triangle; false if a pivot is not positive.
bool factorize(Square a) {
  for (int j = 0; j < a.n; ++j) {
    double pivot = a(j, j);
    for (int k = 0; k < j; ++k) pivot -= a(j, k) * a(j, k);
    if (!(pivot > 0)) return false;
    a(j, j) = std::sqrt(pivot);
    for (int k = 0; k < j; ++k) {
      const double factor = a(j, k);
      for (int i = j + 1; i < a.n; ++i) a(i, j) -= factor * a(i, k);
    }
    for (int i = j + 1; i < a.n; ++i) a(i, j) /= a(j, j);
  }
  return true;
}

// b = L^-1 b
void solveLower(Square l, double* b) {
  for (int j = 0; j < l.n; ++j) {
    b[j] /= l(j, j);
    for (int i = j + 1; i < l.n; ++i) b[i] -= b[j] * l(i, j);
  }
}

// b = L^-T b
void solveUpper(Square l, double* b) {
  for (int j = l.n - 1; j >= 0; --j) {
    for (int i = j + 1; i < l.n; ++i) b[j] -= l(i, j) * b[i];
    b[j] /= l(j, j);
  }
}

// b = A^-1 b by columns for a positive definite A, which is overwritten; not a number for another one.
void solveDefinite(Square a, double* b, int columns) {
  if (!factorize(a)) {
    std::fill(b, b + a.n * columns, std::nan(""));
    return;
  }
  for (int j = 0; j < columns; ++j, b += a.n) {
    solveLower(a, b);
    solveUpper(a, b);
  }
}

// x = c x - s y, y = s x + c y
void rotate(double c, double s, double* x, double* y, int n, int stride) {
  for (int i = 0; i < n; ++i, x += stride, y += stride) {
    const double old = *x;
    *x = c * old - s * *y;
    *y = s * old + c * *y;
  }
}

// Cyclic Jacobi method: A becomes diagonal, V holds the rotations.
void diagonalize(Square a, Square v) {
  std::fill(v.data, v.data + v.n * v.n, 0.0);
  for (int i = 0; i < v.n; ++i) v(i, i) = 1;
  const double norm = std::sqrt(std::inner_product(a.data, a.data + a.n * a.n, a.data, 0.0));
  const double least = 1e-17 * norm;
  bool turned = true;
  for (int sweep = 0; turned && sweep < kMostSweeps; ++sweep) {
    turned = false;
    for (int p = 0; p < a.n; ++p) {
      for (int q = p + 1; q < a.n; ++q) {
        const double off = a(q, p);
        if (!(std::abs(off) > least)) continue;
        turned = true;
        const double ratio = (a(q, q) - a(p, p)) / (2 * off);
        const double t = std::copysign(1.0, ratio) / (std::abs(ratio) + std::sqrt(1 + ratio * ratio));
        const double c = 1 / std::sqrt(1 + t * t), s = t * c;
        rotate(c, s, a.column(p), a.column(q), a.n, 1);
        rotate(c, s, &a(p, 0), &a(q, 0), a.n, a.n);
        a(p, q) = a(q, p) = 0;
        rotate(c, s, v.column(p), v.column(q), v.n, 1);
      }
    }
  }
}

// Eigenvalues, increasing, and their vectors; `a` is overwritten and `work` as large as it.
void eigen(Square a, Square work, double* values, Square vectors) {
  for (int j = 0; j < a.n; ++j) {
    for (int i = 0; i < j; ++i) a(i, j) = a(j, i);
  }
  diagonalize(a, work);
  for (int k = 0; k < a.n; ++k) {
    if (std::isfinite(a(k, k))) continue;
    std::fill(values, values + a.n, std::nan(""));
    std::fill(vectors.data, vectors.data + a.n * a.n, std::nan(""));
    return;
  }
  for (int rank = 0; rank < a.n; ++rank) {
    int least = 0;
    for (int k = 1; k < a.n; ++k) {
      if (a(k, k) < a(least, least)) least = k;
    }
    values[rank] = a(least, least);
    std::copy(work.column(least), work.column(least) + a.n, vectors.column(rank));
    a(least, least) = HUGE_VAL;
  }
}

// b = A^-1 b by columns; Gauss-Jordan with row pivots.
void eliminate(Square a, double* b, int columns) {
  for (int k = 0; k < a.n; ++k) {
    int pivot = k;
    for (int i = k + 1; i < a.n; ++i) {
      if (std::abs(a(i, k)) > std::abs(a(pivot, k))) pivot = i;
    }
    for (int j = k; j < a.n && pivot != k; ++j) std::swap(a(k, j), a(pivot, j));
    for (int j = 0; j < columns && pivot != k; ++j) std::swap(b[k + j * a.n], b[pivot + j * a.n]);
    for (int i = 0; i < a.n; ++i) {
      if (i == k) continue;
      const double factor = a(i, k) / a(k, k);
      for (int j = k + 1; j < a.n; ++j) a(i, j) -= factor * a(k, j);
      for (int j = 0; j < columns; ++j) b[i + j * a.n] -= factor * b[k + j * a.n];
    }
  }
  for (int j = 0; j < columns; ++j) {
    for (int i = 0; i < a.n; ++i) b[i + j * a.n] /= a(i, i);
  }
}

Square square(MatX& a) { return {a.data(), static_cast<int>(a.rows())}; }
Square square(Mat6& a) { return {a.data(), 6}; }

}  // namespace

SymmetricEigen symmetricEigen(const MatX& a) {
  MatX copy = a, work(a.rows(), a.rows());
  SymmetricEigen out{VecX(a.rows()), MatX(a.rows(), a.rows())};
  eigen(square(copy), square(work), out.values.data(), square(out.vectors));
  return out;
}

SymmetricEigen symmetricEigen(const MatX& a, const MatX& b) {
  MatX factor = b, c = a;
  const Square l = square(factor), s = square(c);
  if (!factorize(l)) c.setConstant(std::nan(""));
  for (int j = 0; j < s.n; ++j) {
    for (int i = 0; i < j; ++i) s(i, j) = s(j, i);
  }
  for (int side = 0; side < 2; ++side) {  // L^-1 A, then L^-1 (L^-1 A)^T
    for (int j = 0; j < s.n; ++j) solveLower(l, s.column(j));
    for (int j = 0; j < s.n && side == 0; ++j) {
      for (int i = 0; i < j; ++i) std::swap(s(i, j), s(j, i));
    }
  }
  SymmetricEigen out = symmetricEigen(c);
  for (int j = 0; j < s.n; ++j) solveUpper(l, square(out.vectors).column(j));
  return out;
}

bool isPositiveDefinite(const MatX& a) {
  MatX copy = a;
  return factorize(square(copy));
}

MatX solveSymmetric(const MatX& a, const MatX& b) {
  MatX factor = a, x = b;
  solveDefinite(square(factor), x.data(), static_cast<int>(x.cols()));
  return x;
}

SymmetricEigen6 symmetricEigen(const Mat6& a) noexcept {
  Mat6 copy = a, work;
  SymmetricEigen6 out;
  eigen(square(copy), square(work), out.values.data(), square(out.vectors));
  return out;
}

bool isPositiveDefinite(const Mat6& a) noexcept {
  Mat6 copy = a;
  return factorize(square(copy));
}

Vec6 solve(const Mat6& a, const Vec6& b) noexcept {
  Mat6 copy = a;
  Vec6 x = b;
  eliminate(square(copy), x.data(), 1);
  return x;
}

Mat6 inverse(const Mat6& a) noexcept {
  Mat6 copy = a, out = Mat6::Identity();
  eliminate(square(copy), out.data(), 6);
  return out;
}

Vec6 solveSymmetric(const Mat6& a, const Vec6& b) noexcept {
  Mat6 factor = a;
  Vec6 x = b;
  solveDefinite(square(factor), x.data(), 1);
  return x;
}

}  // namespace palpate
