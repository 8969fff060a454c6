#include "palpate/friction/state_factor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "palpate/friction/contact_solver.h"
#include "palpate/linear/dense_lu.h"
#include "palpate/linear/triangular_solve.h"

namespace palpate {
namespace {

constexpr double kMu = 0.6;
constexpr int kFacets = 8;

// Like what ContactSolver makes of its states: 0 open, 1 stick, 2 + 2 k vertex k, 3 + 2 k edge k.
FreeDirections freeDirections(int state) {
  FreeDirections f;
  if (state == 1) {
    f.dims = 3;
    f.b.setIdentity();
    f.c.setIdentity();
  } else if (state >= 2) {
    const int k = (state - 2) / 2;
    f.c(0, 0) = 1;
    f.b.col(0) = Vec3::UnitX();
    if (state % 2 == 0) {
      f.dims = 1;
      f.b.col(0) += kMu * vertexDirection(k, kFacets);
    } else {
      f.dims = 2;
      f.b.col(0) += kMu * std::cos(std::numbers::pi / kFacets) * edgeNormal(k, kFacets);
      f.b.col(1) = f.c.col(1) = edgeTangent(k, kFacets);
    }
  }
  return f;
}

std::vector<FreeDirections> freeDirections(const std::vector<int>& states) {
  std::vector<FreeDirections> all;
  int offset = 0;
  for (const bool stick : {true, false}) {
    offset = 0;
    for (std::size_t i = 0; i < states.size(); ++i) {
      if (states[i] == 0 || (states[i] == 1) != stick) continue;
      all.push_back(freeDirections(states[i]));
      all.back().contact = static_cast<int>(i);
      all.back().offset = offset;
      offset += all.back().dims;
    }
  }
  return all;
}

class Problem {
 public:
  explicit Problem(int contacts, int rank = -1) : random_(7) {
    const int rows = 3 * contacts;
    const MatX half = MatX::NullaryExpr(rows, rank < 0 ? 2 * rows : rank, [&] { return normal_(random_); });
    w = half * half.transpose() / static_cast<double>(half.cols());
    rho.resize(contacts);
    for (int i = 0; i < contacts; ++i) rho[i] = w.diagonal().segment<3>(3 * i).sum() / 3.0;
    velocity = VecX::NullaryExpr(rows, [&] { return normal_(random_); });
  }
  std::vector<int> states() {
    std::vector<int> all(static_cast<std::size_t>(rho.size()));
    for (int& s : all) s = draw(2 + 2 * kFacets);
    return all;
  }
  int draw(int below) { return std::uniform_int_distribution<int>(0, below - 1)(random_); }

  MatX w;
  VecX rho, velocity;

 private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

// Impulses stay in what the states leave free, and take the velocities away that should vanish there.
void expectSolves(const Problem& p, const std::vector<int>& states, const VecX& change, double tolerance) {
  const VecX v = p.w * change + p.velocity;
  for (int i = 0; i < p.rho.size(); ++i) {
    const FreeDirections f = freeDirections(states[static_cast<std::size_t>(i)]);
    const Vec3 impulse = change.segment<3>(3 * i);
    Vec3 outside = impulse;
    for (int d = 0; d < f.dims; ++d) {
      const Vec3 b = f.b.col(d).normalized();
      outside -= b.dot(impulse) * b;
      EXPECT_NEAR(f.c.col(d).dot(v.segment<3>(3 * i)), 0, tolerance) << "contact " << i;
    }
    EXPECT_NEAR(outside.norm(), 0, tolerance * (1 + change.lpNorm<Eigen::Infinity>())) << "contact " << i;
  }
}

TEST(StateFactor, SolvesWhatStatesLeave) {
  for (const int contacts : {1, 3, 12, 40, 80}) {
    Problem p(contacts);
    const std::vector<int> states = p.states();
    StateFactor factor;
    VecX change;
    ASSERT_TRUE(factor.prepare(p.w, p.rho, freeDirections(states), true));
    EXPECT_FALSE(factor.bordered());
    factor.solve(freeDirections(states), p.velocity, change);
    expectSolves(p, states, change, 1e-7);
  }
}

// Every state to every other, one contact at a time, from the same factor.
TEST(StateFactor, BordersEveryChangeOfState) {
  Problem p(70);
  std::vector<int> states = p.states();
  for (std::size_t i = 0; i < states.size(); i += 2) states[i] = 1;  // enough unknowns
  for (int from = 0; from < 2 + 2 * kFacets; ++from) {
    states[9] = from;
    StateFactor factor;
    VecX change;
    ASSERT_TRUE(factor.prepare(p.w, p.rho, freeDirections(states), true));
    for (int to = 0; to < 2 + 2 * kFacets; ++to) {
      std::vector<int> changed = states;
      changed[9] = to;
      const std::vector<FreeDirections> free = freeDirections(changed);
      ASSERT_TRUE(factor.prepare(p.w, p.rho, free, true));
      EXPECT_EQ(factor.bordered(), from != to) << from << " to " << to;
      factor.solve(free, p.velocity, change);
      SCOPED_TRACE(testing::Message() << from << " to " << to);
      expectSolves(p, changed, change, 1e-7);
    }
  }
}

TEST(StateFactor, BordersSeveralChangesAndFactorizesForMany) {
  Problem p(150);
  std::vector<int> states = p.states();
  StateFactor factor, fresh;
  VecX change, expected;
  ASSERT_TRUE(factor.prepare(p.w, p.rho, freeDirections(states), true));
  int bordered = 0;
  for (int round = 0; round < 12; ++round) {
    for (int k = 0; k < 4; ++k) states[static_cast<std::size_t>(p.draw(150))] = p.draw(2 + 2 * kFacets);
    const std::vector<FreeDirections> free = freeDirections(states);
    ASSERT_TRUE(factor.prepare(p.w, p.rho, free, true));
    bordered += factor.bordered() ? 1 : 0;
    factor.solve(free, p.velocity, change);
    expectSolves(p, states, change, 1e-6);
    ASSERT_TRUE(fresh.prepare(p.w, p.rho, free, false));
    EXPECT_FALSE(fresh.bordered());
    EXPECT_LT(factor.bordered() ? factor.operations() : 0.0, fresh.operations());
    fresh.solve(free, p.velocity, expected);
    EXPECT_LT((change - expected).norm(), 1e-6 * expected.norm());
  }
  EXPECT_GT(bordered, 4);
  for (int& s : states) s = s == 0 ? 5 : 0;
  ASSERT_TRUE(factor.prepare(p.w, p.rho, freeDirections(states), true));
  EXPECT_FALSE(factor.bordered());
}

TEST(StateFactor, TakesTheSameStatesWithoutWorkUntilToldToForget) {
  Problem p(80);
  const std::vector<FreeDirections> free = freeDirections(p.states());
  StateFactor factor;
  VecX change;
  ASSERT_TRUE(factor.prepare(p.w, p.rho, free, true));
  EXPECT_GT(factor.operations(), 0);
  ASSERT_TRUE(factor.prepare(p.w, p.rho, free, true));
  EXPECT_EQ(factor.operations(), 0);
  const MatX twice = 2 * p.w;
  factor.forget();
  ASSERT_TRUE(factor.prepare(twice, 2 * p.rho, free, true));
  EXPECT_GT(factor.operations(), 0);
  VecX before;
  factor.solve(free, p.velocity, change);
  factor.forget();
  ASSERT_TRUE(factor.prepare(p.w, p.rho, free, true));
  factor.solve(free, p.velocity, before);
  EXPECT_LT((2 * change - before).norm(), 1e-9 * before.norm());
}

// More contacts than W has rank for: the factor exists, and repeated solutions take the velocities away that can go.
TEST(StateFactor, HoldsWithRedundantContacts) {
  Problem p(60, 90);
  p.velocity = p.w * p.velocity;  // within reach of impulses
  std::vector<int> states(60, 1);
  StateFactor factor;
  VecX change;
  for (int round = 0; round < 2; ++round) {
    const std::vector<FreeDirections> free = freeDirections(states);
    ASSERT_TRUE(factor.prepare(p.w, p.rho, free, true));
    EXPECT_EQ(factor.bordered(), round == 1);
    VecX v = p.velocity;
    for (int k = 0; k < 4; ++k) {
      factor.solve(free, v, change);
      v += p.w * change;
    }
    for (const FreeDirections& f : free) {
      EXPECT_LT((f.c.transpose() * v.segment<3>(3 * f.contact)).norm(), 1e-5);
    }
    states[5] = 0;
    states[17] = 0;
  }
}

TEST(DenseLu, SolvesWithManySizes) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (const int n : {1, 2, 7, 8, 9, 31, 47, 48, 49, 95, 97, 130, 300}) {
    const MatX a = MatX::NullaryExpr(n, n, [&] { return normal(random); });
    const MatX b = MatX::NullaryExpr(n, 3, [&] { return normal(random); });
    MatX lu = a;
    std::vector<int> pivots;
    ASSERT_TRUE(luInPlace(lu, pivots));
    MatX x = b;
    luSolveColumns(lu, pivots, x);
    EXPECT_LT((a * x - b).norm(), 1e-10 * x.norm() * a.norm()) << n;
    VecX y = b.col(1);
    luSolve(lu, pivots, y);
    EXPECT_LT((y - x.col(1)).norm(), 1e-10 * a.norm() * y.norm()) << n;
    // partial pivoting: no multiplier above one
    EXPECT_LE(MatX(lu.triangularView<Eigen::StrictlyLower>()).lpNorm<Eigen::Infinity>(), 1.0) << n;
  }
}

TEST(TriangularSolve, AgreesWithTheProduct) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (const int n : {1, 5, 8, 9, 47, 48, 49, 96, 97, 131, 250}) {
    for (const int columns : {1, 3, 4, 5, 40}) {
      MatX whole = MatX::NullaryExpr(n + 3, n, [&] { return normal(random) / n; });
      whole.diagonal().array() += 2.0;
      const auto lower = whole.topRows(n);
      const MatX b = MatX::NullaryExpr(n, columns, [&] { return normal(random); });
      MatX x = MatX::Constant(n + 2, columns, 7.0);
      x.topRows(n) = b;
      solveLowerInPlace(lower, x.topRows(n));
      EXPECT_LT((lower.triangularView<Eigen::Lower>() * x.topRows(n) - b).norm(), 1e-13 * b.norm() * n) << n;
      x.topRows(n) = b;
      solveUnitLowerInPlace(lower, x.topRows(n));
      EXPECT_LT((lower.triangularView<Eigen::UnitLower>() * x.topRows(n) - b).norm(), 1e-13 * b.norm() * n) << n;
      EXPECT_TRUE((x.bottomRows(2).array() == 7.0).all());
    }
  }
}

TEST(DenseLu, RefusesWhatHasNoPivot) {
  for (const int n : {5, 60}) {
    MatX a = MatX::Identity(n, n);
    a(3, 3) = 0;
    std::vector<int> pivots;
    EXPECT_FALSE(luInPlace(a, pivots)) << n;
    a.setIdentity();
    a(2, 2) = std::numeric_limits<double>::quiet_NaN();
    EXPECT_FALSE(luInPlace(a, pivots)) << n;
  }
}

}  // namespace
}  // namespace palpate
