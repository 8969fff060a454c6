#include "palpate/linear/sparse_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <limits>
#include <numeric>
#include <random>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/linear/node_ordering.h"
#include "shared/count_allocations.h"
#include "shared/lattice_matrices.h"

namespace palpate {
namespace {

using Numeric = SparseCholesky::Numeric;

/// Nodes on a line of lattice layers with random couplings near by: sparse, connected, positive definite.
SymmetricBlockMatrix randomMatrix(int size, std::uint32_t seed, int reach = 12) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<std::pair<int, int>> pairs;
  for (int i = 1; i < size; ++i) {
    pairs.emplace_back(i, i - 1);
    for (int k = 0; k < 4; ++k) pairs.emplace_back(i, std::max(0, i - 1 - static_cast<int>(random() % reach)));
  }
  SymmetricBlockMatrix matrix = SymmetricBlockMatrix::fromPairs(size, pairs);
  for (int j = 0; j < size; ++j) {
    matrix.block(matrix.column[j]) += 0.1 * Mat3::Identity();
    for (int slot = matrix.column[j] + 1; slot < matrix.column[j + 1]; ++slot) {
      Eigen::Matrix<double, 3, 6> b;  // one positive semi-definite contribution to each coupled pair
      for (int i = 0; i < b.size(); ++i) b.data()[i] = uniform(random);
      const Eigen::Matrix<double, 6, 6> k = b.transpose() * b;
      matrix.block(matrix.column[j]) += k.topLeftCorner<3, 3>();
      matrix.block(matrix.column[matrix.row[slot]]) += k.bottomRightCorner<3, 3>();
      matrix.block(slot) += k.bottomLeftCorner<3, 3>();
    }
  }
  return matrix;
}

MatX dense(const SymmetricBlockMatrix& matrix) {
  MatX a(3 * matrix.size, 3 * matrix.size);
  for (int j = 0; j < matrix.size; ++j) {
    for (int i = j; i < matrix.size; ++i) {
      const int slot = matrix.find(i, j);
      const Mat3 block = slot < 0 ? Mat3(Mat3::Zero()) : Mat3(matrix.block(slot));
      a.block<3, 3>(3 * i, 3 * j) = block;
      a.block<3, 3>(3 * j, 3 * i) = block.transpose();
    }
  }
  return a;
}

MatX randomColumns(Eigen::Index rows, Eigen::Index columns, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  MatX m(rows, columns);
  for (Eigen::Index i = 0; i < m.size(); ++i) m.data()[i] = uniform(random);
  return m;
}

std::vector<int> someNodes(int size, int count, std::uint32_t seed) {
  std::vector<int> nodes(size);
  std::iota(nodes.begin(), nodes.end(), 0);
  std::mt19937 random(seed);
  for (int i = size - 1; i > 0; --i) std::swap(nodes[i], nodes[random() % static_cast<unsigned>(i + 1)]);
  nodes.resize(count);
  return nodes;
}

double relativeError(const MatX& value, const MatX& reference) {
  return (value - reference).norm() / std::max(1e-300, reference.norm());
}

TEST(SymmetricBlockMatrix, PatternFromPairsIsSortedAndComplete) {
  const auto m = SymmetricBlockMatrix::fromPairs(4, {{0, 2}, {2, 0}, {3, 1}, {3, 3}, {1, 0}});
  EXPECT_EQ(m.column, (std::vector<int>{0, 3, 5, 6, 7}));
  EXPECT_EQ(m.row, (std::vector<int>{0, 1, 2, 1, 3, 2, 3}));
  EXPECT_EQ(m.find(2, 0), 2);
  EXPECT_EQ(m.find(3, 0), -1);
  EXPECT_EQ(m.find(0, 2), -1);  // upper triangle
  EXPECT_EQ(m.find(4, 0), -1);
  EXPECT_EQ(m.find(3, 3), 6);
}

TEST(SymmetricBlockMatrix, MultiplyAgreesWithDense) {
  const auto m = randomMatrix(20, 3);
  const VecX x = randomColumns(60, 1, 4);
  EXPECT_LT(relativeError(m.multiply(x), dense(m) * x), 1e-14);
  const MatX columns = randomColumns(60, 5, 6);
  EXPECT_LT(relativeError(m.multiplyColumns(columns), dense(m) * columns), 1e-14);
  EXPECT_EQ(m.diagonal(), dense(m).diagonal());
}

class SparseCholeskyOf : public testing::TestWithParam<std::tuple<int, int, Numeric>> {};

TEST_P(SparseCholeskyOf, SolvesAndGivesTheTrailingFactor) {
  const auto [size, last_count, numeric] = GetParam();
  const SymmetricBlockMatrix matrix = randomMatrix(size, static_cast<std::uint32_t>(size));
  const MatX a = dense(matrix);
  const Eigen::LLT<MatX> reference(a);
  ASSERT_EQ(reference.info(), Eigen::Success);
  const std::vector<int> last = someNodes(size, last_count, 5);

  SparseCholesky cholesky;
  cholesky.analyze(matrix, last, numeric);
  ASSERT_TRUE(cholesky.factorize(matrix));
  EXPECT_EQ(cholesky.statistics().dof, 3 * size);
  EXPECT_EQ(cholesky.statistics().last, 3 * last_count);

  for (const int columns : {1, 2, 4, 5, 8, 9, 12, 16, 17, 40}) {
    const MatX rhs = randomColumns(3 * size, columns, 7);
    MatX x = rhs;
    cholesky.solve(x);
    EXPECT_LT(relativeError(a * x, rhs), 1e-11) << columns << " columns";
    MatX half = rhs;
    cholesky.halfSolve(half);
    EXPECT_LT(relativeError(half.transpose() * half, rhs.transpose() * reference.solve(rhs)), 1e-10);
  }

  // columns on one to five nodes, also one of no node and one twice on the same; in one part, in two and in several
  std::mt19937 random(13);
  const auto sparseColumns = [&random, size = size](int count) {
    BlockColumns columns;
    for (int c = 0; c < count; ++c) {
      for (int k = 0; k < (c == 3 ? 0 : 1 + c % 5); ++k) {
        const MatX block = randomColumns(3, 3, static_cast<std::uint32_t>(100 + 5 * c + k));
        columns.add(static_cast<int>(random() % static_cast<unsigned>(size)), block);
        if (c == 4 && k == 0) columns.add(columns.node.back(), block);
      }
      columns.close();
    }
    return columns;
  };
  const auto whole = [size = size](const BlockColumns& columns) {
    MatX acting = MatX::Zero(3 * size, 3 * columns.size());
    for (int c = 0; c < columns.size(); ++c) {
      for (int k = columns.begin[c]; k < columns.begin[c + 1]; ++k)
        acting.block<3, 3>(3 * columns.node[k], 3 * c) += columns.block[k];
    }
    return acting;
  };
  for (const int count : {5, 25, 130}) {
    const BlockColumns columns = sparseColumns(count);
    const MatX acting = whole(columns);
    MatX gram, again;
    cholesky.gram(columns, gram);
    ASSERT_EQ(gram.rows(), 3 * count);
    const MatX full = gram.selfadjointView<Eigen::Lower>();
    EXPECT_LT(relativeError(full, acting.transpose() * reference.solve(acting)), 1e-10) << count << " contacts";
    cholesky.gram(columns, again);
    EXPECT_EQ(MatX((again - gram).triangularView<Eigen::Lower>()).norm(), 0.0) << count << " contacts";
  }
  // chunks of right columns of each width, and what was left of larger ones
  for (const auto& [left_count, right_count] : std::vector<std::pair<int, int>>{{40, 11}, {4, 16}, {9, 1}, {3, 2}}) {
    const BlockColumns left = sparseColumns(left_count), right = sparseColumns(right_count);
    MatX out;
    cholesky.between(left, right, out);
    EXPECT_LT(relativeError(out, whole(left).transpose() * reference.solve(whole(right))), 1e-10)
        << left_count << " by " << right_count;
  }
  MatX none;
  cholesky.between(BlockColumns{}, sparseColumns(2), none);
  EXPECT_EQ(none.rows(), 0);
  EXPECT_EQ(none.cols(), 6);

  // E_c: the last nodes' columns of the identity, in their order
  MatX e = MatX::Zero(3 * size, 3 * last_count);
  for (int k = 0; k < last_count; ++k) e.block<3, 3>(3 * last[k], 3 * k).setIdentity();
  const MatX& l = cholesky.trailing();
  ASSERT_EQ(l.rows(), 3 * last_count);
  EXPECT_EQ(MatX(l.triangularView<Eigen::StrictlyUpper>()).norm(), 0.0);
  if (last_count == 0) return;
  const MatX condensed = e.transpose() * reference.solve(e);  // inverse of the Schur complement
  EXPECT_LT(relativeError(l * l.transpose() * condensed, MatX::Identity(l.rows(), l.rows())), 1e-10);

  for (const int count : {1, 6}) {
    const MatX r = randomColumns(3 * last_count, count, 11);
    MatX x = MatX::Constant(3 * size, count, 1e9);  // whatever was there must not matter
    cholesky.solveFromTrailing(r, x);
    EXPECT_LT(relativeError(x, reference.solve(e * r)), 1e-10);
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, SparseCholeskyOf,
                         testing::Values(std::tuple(1, 0, Numeric::compact), std::tuple(1, 1, Numeric::compact),
                                         std::tuple(2, 1, Numeric::compact), std::tuple(7, 3, Numeric::compact),
                                         std::tuple(40, 0, Numeric::compact), std::tuple(40, 9, Numeric::compact),
                                         std::tuple(40, 40, Numeric::compact), std::tuple(120, 30, Numeric::automatic),
                                         std::tuple(150, 1, Numeric::compact), std::tuple(1, 1, Numeric::cholmod),
                                         std::tuple(40, 0, Numeric::cholmod), std::tuple(40, 40, Numeric::cholmod),
                                         std::tuple(120, 30, Numeric::cholmod)));

TEST(SparseCholesky, BothFactorizationsAgree) {
  const auto matrix = randomMatrix(100, 2);
  const auto last = someNodes(100, 20, 3);
  SparseCholesky compact, library;
  compact.analyze(matrix, last, Numeric::compact);
  library.analyze(matrix, last, Numeric::cholmod);
  ASSERT_TRUE(compact.factorize(matrix));
  ASSERT_TRUE(library.factorize(matrix));
  EXPECT_LT(relativeError(compact.trailing(), library.trailing()), 1e-13);
  EXPECT_EQ(compact.statistics().nonzeros, library.statistics().nonzeros);
}

TEST(SparseCholesky, DisconnectedBodies) {
  // two chains and a lone node; the last nodes lie in different ones, so their Schur complement has zero blocks
  std::vector<std::pair<int, int>> pairs;
  for (int i = 1; i < 10; ++i) pairs.emplace_back(i, i - 1), pairs.emplace_back(10 + i, 9 + i);
  auto matrix = SymmetricBlockMatrix::fromPairs(21, pairs);
  for (int j = 0; j < 21; ++j)
    for (int s = matrix.column[j]; s < matrix.column[j + 1]; ++s)
      matrix.block(s) = (matrix.row[s] == j ? 3.0 : -1.0) * Mat3::Identity();
  const MatX inverse = dense(matrix).inverse();
  const std::vector<int> last = {20, 12, 3};
  for (const Numeric numeric : {Numeric::compact, Numeric::cholmod}) {
    SparseCholesky cholesky;
    cholesky.analyze(matrix, last, numeric);
    ASSERT_TRUE(cholesky.factorize(matrix));
    MatX x = MatX::Identity(63, 63);
    cholesky.solve(x);
    EXPECT_LT(relativeError(x, inverse), 1e-13);
    const MatX schur = cholesky.trailing() * cholesky.trailing().transpose();
    MatX condensed(9, 9);
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) condensed.block<3, 3>(3 * a, 3 * b) = inverse.block<3, 3>(3 * last[a], 3 * last[b]);
    EXPECT_LT(relativeError(schur * condensed, MatX::Identity(9, 9)), 1e-13);
  }
}

TEST(SparseCholesky, RefactorizesChangedValues) {
  auto matrix = randomMatrix(60, 8);
  for (const Numeric numeric : {Numeric::compact, Numeric::cholmod}) {
    SparseCholesky cholesky;
    cholesky.analyze(matrix, someNodes(60, 10, 1), numeric);
    ASSERT_TRUE(cholesky.factorize(matrix));
    auto changed = randomMatrix(60, 8);
    for (int j = 0; j < 60; ++j) changed.block(changed.column[j]) += (1.0 + 0.1 * j) * Mat3::Identity();
    ASSERT_TRUE(cholesky.factorize(changed));
    const MatX rhs = randomColumns(180, 3, 2);
    MatX x = rhs;
    cholesky.solve(x);
    EXPECT_LT(relativeError(dense(changed) * x, rhs), 1e-12);
  }
}

TEST(SparseCholesky, OtherPatternAfterwards) {
  SparseCholesky cholesky;
  for (const int size : {30, 80, 5}) {
    const auto matrix = randomMatrix(size, 4);
    for (const Numeric numeric : {Numeric::cholmod, Numeric::compact}) {
      cholesky.analyze(matrix, someNodes(size, 2, 1), numeric);
      ASSERT_TRUE(cholesky.factorize(matrix));
      const MatX rhs = randomColumns(3 * size, 1, 2);
      MatX x = rhs;
      cholesky.solve(x);
      EXPECT_LT(relativeError(dense(matrix) * x, rhs), 1e-11);
    }
  }
}

TEST(SparseCholesky, RefusesWhatIsNotPositiveDefinite) {
  const auto good = randomMatrix(30, 6);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  for (const Numeric numeric : {Numeric::compact, Numeric::cholmod}) {
    SparseCholesky cholesky;
    cholesky.analyze(good, someNodes(30, 6, 1), numeric);
    for (const double bad : {-1.0, nan, inf, -inf}) {
      for (const int node : {0, 13, 29}) {
        auto matrix = good;
        matrix.block(matrix.column[node])(1, 1) = bad;
        EXPECT_FALSE(cholesky.factorize(matrix)) << bad << " on the diagonal of node " << node;
        matrix = good;
        if (bad == -1.0 || node == 29) continue;
        matrix.block(matrix.column[node] + 1)(2, 0) = bad;
        EXPECT_FALSE(cholesky.factorize(matrix)) << bad << " beside the diagonal of node " << node;
      }
    }
    auto zero = good;
    std::fill(zero.values.begin(), zero.values.end(), 0.0);
    EXPECT_FALSE(cholesky.factorize(zero));
    EXPECT_TRUE(cholesky.factorize(good));  // and recovers
    const MatX rhs = randomColumns(90, 1, 2);
    MatX x = rhs;
    cholesky.solve(x);
    EXPECT_LT(relativeError(dense(good) * x, rhs), 1e-11);
  }
}

TEST(SparseCholesky, IndefiniteOnlyInTheSchurComplement) {
  // positive diagonal blocks throughout: only the elimination shows it
  auto matrix = SymmetricBlockMatrix::fromPairs(2, {{0, 1}});
  matrix.block(0) = matrix.block(2) = Mat3::Identity();
  matrix.block(1) = 1.01 * Mat3::Identity();
  for (const Numeric numeric : {Numeric::compact, Numeric::cholmod}) {
    SparseCholesky cholesky;
    cholesky.analyze(matrix, {}, numeric);
    EXPECT_FALSE(cholesky.factorize(matrix));
  }
}

TEST(SparseCholesky, ThrowsOnMisuse) {
  const auto matrix = randomMatrix(10, 1);
  SparseCholesky cholesky;
  EXPECT_THROW(cholesky.analyze(matrix, std::vector<int>{1, 1}), std::invalid_argument);
  EXPECT_THROW(cholesky.analyze(matrix, std::vector<int>{10}), std::invalid_argument);
  EXPECT_THROW(cholesky.analyze(matrix, std::vector<int>{-1}), std::invalid_argument);
  EXPECT_THROW(cholesky.factorize(matrix), std::invalid_argument);
  cholesky.analyze(matrix);
  EXPECT_THROW(cholesky.factorize(randomMatrix(11, 1)), std::invalid_argument);
}

TEST(SparseCholesky, EmptyMatrix) {
  const auto matrix = SymmetricBlockMatrix::fromPairs(0, {});
  SparseCholesky cholesky;
  cholesky.analyze(matrix);
  EXPECT_TRUE(cholesky.factorize(matrix));
  MatX x(0, 3);
  cholesky.solve(x);
  EXPECT_EQ(cholesky.trailing().size(), 0);
}

TEST(SparseCholesky, RepeatsToTheBit) {
  const auto matrix = randomMatrix(90, 12);
  const auto last = someNodes(90, 15, 2);
  for (const Numeric numeric : {Numeric::compact, Numeric::cholmod}) {
    SparseCholesky first, second;
    for (SparseCholesky* cholesky : {&first, &second}) {
      cholesky->analyze(matrix, last, numeric);
      ASSERT_TRUE(cholesky->factorize(matrix));
    }
    ASSERT_TRUE(second.factorize(matrix));  // a repetition on the same object as well
    MatX a = randomColumns(270, 12, 1), b = a;
    first.solve(a);
    second.solve(b);
    EXPECT_TRUE((a.array() == b.array()).all());
    EXPECT_TRUE((first.trailing().array() == second.trailing().array()).all());
  }
}

TEST(SparseCholesky, SteadyStateDoesNotAllocate) {
  if (!test::kCountsMalloc) GTEST_SKIP() << "malloc belongs to a sanitizer here";
  const auto matrix = randomMatrix(90, 12);
  SparseCholesky cholesky;
  cholesky.analyze(matrix, someNodes(90, 15, 2), Numeric::compact);
  MatX many = randomColumns(270, 30, 1), one = randomColumns(270, 1, 1);
  const MatX r = randomColumns(45, 1, 1);
  const int count = test::allocationsIn([&] {
    ASSERT_TRUE(cholesky.factorize(matrix));
    cholesky.solve(many);
    cholesky.solve(one);
    cholesky.halfSolve(many);
    cholesky.solveFromTrailing(r, one);
  });
  EXPECT_EQ(count, 0);
}

// More nodes at the end, moved there: solves and trailing block are right, and which orders the object knew before does
// not change a bit.
TEST(SparseCholesky, ExtendedOrderIsRightAndTheSameFromAnew) {
  constexpr std::size_t kSought = 6;
  const SymmetricBlockMatrix matrix = randomMatrix(120, 8);
  const MatX a = dense(matrix);
  const std::vector<int> last = someNodes(120, 20, 3);
  SparseCholesky grown, anew;
  grown.analyze(matrix, std::span(last).first(kSought));
  grown.extend(matrix, std::span(last).first(kSought + 4), kSought);
  for (SparseCholesky* cholesky : {&grown, &anew}) {
    cholesky->extend(matrix, last, kSought);
    ASSERT_TRUE(cholesky->factorize(matrix));
  }
  EXPECT_EQ(grown.statistics().ordering, "extended");
  EXPECT_GE(grown.statistics().flops, grown.statistics().sought_flops);
  const MatX rhs = randomColumns(360, 5, 9);
  MatX x = rhs, y = rhs;
  grown.solve(x);
  anew.solve(y);
  EXPECT_LT(relativeError(a * x, rhs), 1e-11);
  EXPECT_EQ(x, y);
  const MatX inverse = a.inverse();
  MatX block(60, 60);
  for (int i = 0; i < 20; ++i) {
    for (int j = 0; j < 20; ++j) block.block<3, 3>(3 * i, 3 * j) = inverse.block<3, 3>(3 * last[i], 3 * last[j]);
  }
  const MatX lower = grown.trailing();
  EXPECT_LT(relativeError(block * (lower * lower.transpose()), MatX::Identity(60, 60)), 1e-10);
  EXPECT_THROW(grown.extend(matrix, last, last.size() + 1), std::invalid_argument);

  // another matrix of the same size, with the same nodes
  const SymmetricBlockMatrix other = randomMatrix(120, 11);
  grown.extend(other, last, kSought);
  ASSERT_TRUE(grown.factorize(other));
  x = rhs;
  grown.solve(x);
  EXPECT_LT(relativeError(dense(other) * x, rhs), 1e-11);
}

// A bar for which METIS finds the best order: as alone, while other threads ask it as well.
TEST(NodeOrdering, IsTheSameWhileOthersAreFound) {
  constexpr int kTimes = 8;
  const SymmetricBlockMatrix lattice = test::barMatrix(11, 11, 11).matrix;
  const NodeOrdering alone = orderNodes(lattice, {});
  EXPECT_TRUE(alone.name == "metis" || alone.name == "nested-dissection") << alone.name;
  std::vector<int> same(4, 0);
  std::vector<std::thread> threads;
  for (int& own : same) {
    threads.emplace_back([&] {
      for (int k = 0; k < kTimes; ++k) own += orderNodes(lattice, {}).order == alone.order ? 1 : 0;
    });
  }
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(same, std::vector<int>(4, kTimes));
}

}  // namespace
}  // namespace palpate
