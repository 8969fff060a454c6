#include "palpate/math/decompositions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace palpate {
namespace {

MatX randomMatrix(int n, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  MatX out(n, n);
  for (int i = 0; i < n * n; ++i) out.data()[i] = normal(random);
  return out;
}

MatX definite(int n, unsigned seed) {
  const MatX x = randomMatrix(n, seed);
  return x * x.transpose() + 0.1 * MatX::Identity(n, n);
}

void expectEigen(const MatX& a, const MatX& b, const VecX& values, const MatX& vectors) {
  const auto n = a.rows();
  const double scale = a.norm() + 1e-300;
  EXPECT_LT((a * vectors - b * vectors * values.asDiagonal()).norm(), 1e-12 * scale * (1 + vectors.norm()));
  EXPECT_LT((vectors.transpose() * b * vectors - MatX::Identity(n, n)).norm(), 1e-11);
  for (Eigen::Index k = 1; k < n; ++k) EXPECT_LE(values[k - 1], values[k]);
}

TEST(Decompositions, EigenvectorsAreEigenvectors) {
  for (const int n : {0, 1, 2, 3, 6, 17, 48}) {
    const MatX x = randomMatrix(n, 7u + static_cast<unsigned>(n)), a = x + x.transpose();
    const SymmetricEigen eigen = symmetricEigen(a);
    expectEigen(a, MatX::Identity(n, n), eigen.values, eigen.vectors);
  }
}

TEST(Decompositions, EigenvaluesThatAreEqualOrZero) {
  MatX direction = randomMatrix(6, 3).leftCols(1);
  direction.normalize();
  const MatX flat = direction * direction.transpose();
  for (const MatX& a : {MatX(MatX::Zero(6, 6)), MatX(3 * MatX::Identity(6, 6)), flat, MatX(1e-12 * flat)}) {
    const SymmetricEigen eigen = symmetricEigen(a);
    expectEigen(a, MatX::Identity(6, 6), eigen.values, eigen.vectors);
    EXPECT_NEAR(eigen.values.sum(), a.trace(), 1e-14 * a.norm());
  }
}

TEST(Decompositions, OnlyTheLowerTriangleCounts) {
  const MatX a = definite(6, 5);
  MatX lower = a.triangularView<Eigen::Lower>();
  lower(0, 5) = 1e9;
  EXPECT_EQ(symmetricEigen(lower).values, symmetricEigen(a).values);
  EXPECT_EQ(solveSymmetric(lower, a), solveSymmetric(a, a));
  EXPECT_TRUE(isPositiveDefinite(lower));
}

TEST(Decompositions, GeneralizedEigenvectors) {
  for (const int n : {1, 6, 14}) {
    const MatX x = randomMatrix(n, 11), a = x + x.transpose(), b = definite(n, 12);
    const SymmetricEigen eigen = symmetricEigen(a, b);
    expectEigen(a, b, eigen.values, eigen.vectors);
  }
}

TEST(Decompositions, SixBySixAsTheLarger) {
  const MatX a = definite(6, 21), x = randomMatrix(6, 22);
  const Mat6 six = a;
  const SymmetricEigen6 eigen = symmetricEigen(six);
  expectEigen(a, MatX::Identity(6, 6), eigen.values, eigen.vectors);
  const Vec6 b = x.col(0);
  EXPECT_LT((six * solveSymmetric(six, b) - b).norm(), 1e-12 * b.norm() * six.norm());
  EXPECT_LT((a * solveSymmetric(a, x) - x).norm(), 1e-12 * x.norm() * a.norm());
}

TEST(Decompositions, RowsArePivoted) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    Mat6 a = randomMatrix(6, 100 + seed);
    a(0, 0) = a(1, 1) = 0;  // without pivots a division by zero
    const Vec6 b = a.col(3) - a.col(5);
    EXPECT_LT((a * solve(a, b) - b).norm(), 1e-11 * b.norm());
    EXPECT_LT((a * inverse(a) - Mat6::Identity()).norm(), 1e-10);
  }
}

TEST(Decompositions, WhatIsNotDefiniteIsFound) {
  Mat6 a = Mat6::Identity();
  EXPECT_TRUE(isPositiveDefinite(a));
  a(4, 4) = -1e-12;
  EXPECT_FALSE(isPositiveDefinite(a));
  EXPECT_FALSE(isPositiveDefinite(MatX(a)));
  EXPECT_TRUE(solveSymmetric(a, Vec6(Vec6::Ones())).array().isNaN().all());
  EXPECT_TRUE(solveSymmetric(MatX(a), MatX(MatX::Ones(6, 2))).array().isNaN().all());
  EXPECT_TRUE(symmetricEigen(MatX(MatX::Identity(6, 6)), MatX(a)).values.array().isNaN().all());
  a(2, 1) = std::nan("");
  EXPECT_FALSE(isPositiveDefinite(a));
}

}  // namespace
}  // namespace palpate
