#include "palpate/reduction/modes.h"

#include <gtest/gtest.h>

#include "palpate/linear/sparse_cholesky.h"
#include "palpate/math/decompositions.h"
#include "palpate/reduction/reduce.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kBarStep = 0.033;
constexpr int kWanted = 8;

// A bar held by its top: A = M + h^2 K, its stiffness times a factor.
struct Bar {
  BodyModel body;
  VecX mass;
  SymmetricBlockMatrix matrix;
  SparseCholesky factor;
  int solves = 0;

  explicit Bar(double stiffer = 1) : body(bar({4, 3, 3}, soft(stiffer))) {
    holdNodes(body, onTop, kPlainHandle);
    mass = freeMasses(body);
    matrix = body.pattern();
    const ElasticState elastic = body.startState().elastic;
    body.elasticity().assemble(1.0, kBarStep * kBarStep, elastic, matrix);
    factor.analyze(matrix);
    if (!factor.factorize(matrix)) ADD_FAILURE();
  }
  static Material soft(double stiffer) {
    Material material;
    material.youngs_modulus = 2e4 * stiffer;
    return material;
  }
  Modes find(const MatX& start, bool with_matrix = true) {
    solves = 0;
    return findModes(
        {mass.size(), 1.0, kBarStep * kBarStep,
         [this](MatX& columns) {
           ++solves;
           factor.solve(columns);
         },
         [this](const MatX& columns) { return MatX(mass.asDiagonal() * columns); }, with_matrix ? &matrix : nullptr},
        start, kWanted);
  }
  // of the energy that the exact modes have
  double error(const Modes& modes) {
    const MatX dense = matrix.multiplyColumns(MatX::Identity(mass.size(), mass.size()));
    const SymmetricEigen exact = symmetricEigen(dense, MatX(mass.asDiagonal()));
    const VecX expected = (exact.values.head(kWanted).array() - 1.0) / (kBarStep * kBarStep);
    return ((modes.squared_frequency.head(kWanted) - expected).array() / expected.array()).abs().maxCoeff();
  }
};

TEST(Modes, ThoseThatStillAreAreNotSoughtAgain) {
  Bar bar;
  const MatX start = bar.find({}).shapes.leftCols(kWanted);
  EXPECT_GT(bar.solves, 1);
  const Modes again = bar.find(start);
  EXPECT_EQ(bar.solves, 0);
  EXPECT_EQ(again.shapes.cols(), kWanted);
  EXPECT_LT(bar.error(again), 1e-3);
  // nothing to tell by: sought
  bar.find(start, false);
  EXPECT_EQ(bar.solves, 1);
}

TEST(Modes, OneScaleOfStiffnessChangesNone) {
  Bar bar, stiff(1.3);
  const MatX start = bar.find({}).shapes.leftCols(kWanted);
  const Modes found = stiff.find(start);
  EXPECT_EQ(stiff.solves, 0);
  EXPECT_LT(stiff.error(found), 1e-3);
}

TEST(Modes, OthersAreSought) {
  Bar bar;
  const Modes first = bar.find({});
  MatX start = first.shapes.leftCols(kWanted);
  // one that is a little of what the body can do elsewhere, of the same norm
  VecX other = VecX::Zero(start.rows());
  for (Eigen::Index i = 0; i < other.size(); ++i) other[i] = std::sin(static_cast<double>(i * i));
  other /= std::sqrt(other.dot(bar.mass.cwiseProduct(other)));
  start.col(2) = (start.col(2) + 0.3 * other) / std::sqrt(1 + 0.09);
  const Modes found = bar.find(start);
  EXPECT_EQ(bar.solves, 1);
  EXPECT_LT(bar.error(found), 0.02);
  EXPECT_GT(found.shapes.cols(), kWanted);
}

}  // namespace
}  // namespace palpate
