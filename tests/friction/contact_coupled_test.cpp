// Contact between bodies: stacks, mass ratios, wedges, separate piles; what a solve gives back when it is cut short.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "shared/contact_rivals.h"
#include "shared/coupled_problems.h"
#include "shared/solved_contacts.h"

namespace palpate {
namespace {

using namespace test;

/// What a step may rely on whether the solve converged or not.
void expectSafe(const OwnedProblem& p, const Solution& s) {
  const double slack = 1.01e-10 * velocityScale(p);
  ASSERT_TRUE(s.lambda.allFinite());
  // in a jam the impulses can be enormous, and so is the rounding of W lambda
  const double rounding = 1e-14 * p.delassus.lpNorm<Eigen::Infinity>() * s.lambda.lpNorm<1>();
  EXPECT_NEAR(s.report.residual, contactResidual(p.view(), s.lambda), 1e-12 * velocityScale(p) + rounding);
  double pushed = 0.0;
  for (int i = 0; i < p.contacts(); ++i) {
    const double n = s.lambda[3 * i], radius = p.friction[i] * n;
    const Eigen::Vector2d t = s.lambda.segment<2>(3 * i + 1);
    EXPECT_GE(n, 0.0) << "pulls";
    EXPECT_LE((t - rivals::nearestInSection(p.cone, radius, t)).norm(), 1e-12 * radius) << "outside the cone";
    EXPECT_LE(t.dot(s.w.segment<2>(3 * i + 1)), (slack + rounding) * t.norm() + 1e-15 * n * velocityScale(p))
        << "friction drives " << i;
    pushed += n * std::max(0.0, p.bias[i]);
    EXPECT_EQ(s.status[i].state == ContactState::open, n == 0.0);
  }
  const double work = s.lambda.dot(0.5 * p.delassus * s.lambda + p.free) - pushed;
  EXPECT_LE(work, 1.01 * (slack + rounding) * s.lambda.lpNorm<1>());
}

TEST(CoupledContact, EveryIterateIsSafe) {
  for (const auto& [kind, name] : allCouplings()) {
    for (const FrictionCone& cone : bothCones()) {
      for (const double mu : {0.5, 5.0}) {
        CoupledScene scene;
        scene.kind = kind;
        scene.contacts = 30;
        scene.mu = mu;
        CoupledProblem p = scene.make(cone);
        for (int i = 0; i < p.contacts(); i += 3) p.bias[i] += 0.02;  // some start inside each other
        for (const int iterations : {0, 1, 2, 3, 5, 9, 15, 40}) {
          SCOPED_TRACE(std::string(name) + " mu " + std::to_string(mu) + " iterations " + std::to_string(iterations));
          ContactSolverSettings settings;
          settings.max_iterations = iterations;
          expectSafe(p, solve(p, settings));
        }
      }
    }
  }
}

TEST(CoupledContact, NonsenseAsWarmStartIsMadeSafe) {
  for (const FrictionCone& cone : bothCones()) {
    CoupledScene scene;
    scene.kind = Coupling::alternating;
    scene.contacts = 30;
    const CoupledProblem p = scene.make(cone);
    ContactSolverSettings settings;
    settings.max_iterations = 0;
    Solution s;
    s.lambda = VecX::LinSpaced(3 * p.contacts(), -1.0, 1.0);
    ContactSolver solver;
    s.report = solver.solve(p.view(), settings, s.lambda, s.status);
    s.w = p.delassus * s.lambda + p.free;
    expectSafe(p, s);
  }
}

TEST(CoupledContact, MassRatiosAndWedgesConverge) {
  for (const FrictionCone& cone : bothCones()) {
    for (const auto& [kind, name] : allCouplings()) {
      SCOPED_TRACE(name);
      CoupledScene scene;
      scene.kind = kind;
      scene.contacts = 10;
      for (scene.seed = 1; scene.seed <= 4; ++scene.seed) {
        const CoupledProblem p = scene.make(cone);
        const Solution s = solve(p);
        EXPECT_TRUE(s.report.converged) << "seed " << scene.seed << " residual " << s.report.residual;
        expectSafe(p, s);
      }
    }
  }
}

TEST(CoupledContact, StackedWeightsAddUp) {
  // five rigid boxes of 0.1 and 10 kg in turn, brought to rest: each interface carries what stands on it
  const double press = 0.2;
  for (const FrictionCone& cone : bothCones()) {
    for (const int side : {2, 5}) {  // points along an edge of a face
      Assembly a;
      for (int level = 0; level < 5; ++level) {
        const int box = a.addRigid(level % 2 == 0 ? 0.1 : 10.0, {0.1, 0.1, 0.1}, {0, 0, -press});
        for (int i = 0; i < side * side; ++i) {
          const double x = 0.1 * (i % side) / (side - 1) - 0.05, y = 0.1 * (i / side) / (side - 1) - 0.05;
          const auto below = level == 0 ? Assembly::Point{} : a.onRigid(box - 1, {x, y, 0.05});
          a.addContact(a.onRigid(box, {x, y, -0.05}), below, Vec3::UnitZ(), 0.0, 0.5);
        }
      }
      const CoupledProblem p = a.make(cone);
      const Solution s = solve(p);
      EXPECT_TRUE(s.report.converged) << s.report.residual;
      for (int level = 0; level < 5; ++level) {
        double above = 0.0, sum = 0.0;
        for (int body = level; body < 5; ++body) above += press * p.system(6 * body, 6 * body);
        for (int i = 0; i < side * side; ++i) sum += s.lambda[3 * (level * side * side + i)];
        EXPECT_NEAR(sum, above, 1e-8 * above) << "level " << level;
      }
    }
  }
}

/// A flat box on the ground by its four corners (redundant: twelve rows, six freedoms).
OwnedProblem flatBox(double mu, const Vec3& velocity, const FrictionCone& cone) {
  Assembly a;
  const int box = a.addRigid(2.0, {0.4, 0.4, 0.01}, velocity);
  for (const double x : {-0.2, 0.2})
    for (const double y : {-0.2, 0.2}) a.addContact(a.onRigid(box, {x, y, -0.005}), {}, Vec3::UnitZ(), 0.0, mu);
  return a.make(cone);
}

TEST(CoupledContact, StaticFrictionHoldsUpToItsLimit) {
  const double press = 0.1, mu = 0.6;
  for (const FrictionCone& cone : bothCones()) {
    const Solution held = solve(flatBox(mu, {mu * press * (1 - 1e-6), 0, -press}, cone));
    EXPECT_TRUE(held.report.converged);
    EXPECT_LT(held.w.norm(), 1e-10);
    const double excess = 1e-3;
    const Solution slips = solve(flatBox(mu, {mu * press * (1 + excess), 0, -press}, cone));
    EXPECT_TRUE(slips.report.converged);
    for (int i = 0; i < 4; ++i) EXPECT_NEAR(slips.w[3 * i + 1], mu * press * excess, 1e-9);
  }
}

TEST(CoupledContact, SlidingFrictionOpposesTheMotion) {
  const double press = 0.1, mu = 0.6;
  for (const double angle : {0.0, 0.4, 2.0, 4.0}) {
    const Eigen::Vector2d along(std::cos(angle), std::sin(angle));
    const OwnedProblem p = flatBox(mu, {0.5 * along[0], 0.5 * along[1], -press}, {true, 8});
    const Solution s = solve(p);
    EXPECT_TRUE(s.report.converged);
    Eigen::Vector2d total = Eigen::Vector2d::Zero();
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector2d t = s.lambda.segment<2>(3 * i + 1), v = s.w.segment<2>(3 * i + 1);
      EXPECT_LE(std::abs(t[0] * v[1] - t[1] * v[0]), 1e-8 * t.norm() * v.norm());
      EXPECT_LT(t.dot(v), 0.0);
      total += t;
    }
    EXPECT_LT((total + 2.0 * mu * press * along).norm(), 1e-9);
  }
}

TEST(CoupledContact, SeparatePartsAreSolvedAsIfAlone) {
  for (const FrictionCone& cone : bothCones()) {
    CoupledScene scene;
    scene.contacts = 20;
    std::vector<OwnedProblem> alone;
    for (scene.seed = 1; scene.seed <= 3; ++scene.seed) alone.push_back(scene.make(cone));
    // contacts of the three in turn, so that no part is in one piece
    const int m = 20, n = 3 * m;
    OwnedProblem all;
    all.cone = cone;
    all.delassus = MatX::Zero(3 * n, 3 * n);
    all.free.resize(3 * n);
    all.bias.resize(n);
    all.friction.resize(n);
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < m; ++i) {
        const int at = 3 * i + k;
        for (int j = 0; j < m; ++j)
          all.delassus.block<3, 3>(3 * at, 3 * (3 * j + k)) = alone[k].delassus.block<3, 3>(3 * i, 3 * j);
        all.free.segment<3>(3 * at) = alone[k].free.segment<3>(3 * i);
        all.bias[at] = alone[k].bias[i];
        all.friction[at] = alone[k].friction[i];
      }
    const Solution together = solve(all);
    EXPECT_TRUE(together.report.converged);
    expectSafe(all, together);
    for (int k = 0; k < 3; ++k) {
      const Solution s = solve(alone[k]);
      for (int i = 0; i < m; ++i) {
        EXPECT_LT((together.w.segment<3>(3 * (3 * i + k)) - s.w.segment<3>(3 * i)).norm(), 1e-8 * velocityScale(all));
      }
    }
    ContactSolver solver;  // and a solution given back is returned as it is
    Solution again = together;
    again.report = solver.solve(all.view(), {}, again.lambda, again.status);
    EXPECT_EQ(again.report.iterations, 0);
    EXPECT_EQ(again.status, together.status);
  }
}

TEST(CoupledContact, WorkIsBounded) {
  CoupledScene scene;
  scene.contacts = 40;
  scene.mu = 5.0;
  const CoupledProblem p = scene.make({true, 8});
  ContactSolverSettings settings;
  settings.tolerance = 0.0;  // never content
  settings.max_iterations = 1000000;
  int before = 0;
  for (const double work : {0.0, 0.1, 1.0, 5.0}) {
    settings.max_work = work;
    const Solution s = solve(p, settings);
    EXPECT_FALSE(s.report.converged);
    EXPECT_TRUE(work == 0.0 ? s.report.iterations == 0 : s.report.iterations > before);
    EXPECT_LE(s.report.iterations, 1 + 4000 * work);
    EXPECT_EQ(s.lambda, solve(p, settings).lambda) << "a count, not a clock";
    before = s.report.iterations;
  }
}

TEST(ContactRivals, GiveTheSameVelocities) {
  CoupledScene scene;
  scene.kind = Coupling::uneven;
  scene.contacts = 12;
  scene.mu = 0.3;
  for (const FrictionCone& cone : bothCones()) {
    const CoupledProblem p = scene.make(cone);
    const Solution s = solve(p);
    ASSERT_TRUE(s.report.converged);
    const auto expectSame = [&](const rivals::Outcome& o, double accuracy, const char* name) {
      SCOPED_TRACE(name);
      EXPECT_LE(o.residual, accuracy);
      EXPECT_LT((p.delassus * o.lambda + p.free - s.w).norm(), 1e3 * accuracy * velocityScale(p));
    };
    expectSame(rivals::projectedGaussSeidel(p.view(), 1e-8, 5000), 1e-8, "projected Gauss-Seidel");
    expectSame(rivals::nonsmoothNewton(p.view(), 1e-8, 100), 1e-8, "nonsmooth Newton");
    expectSame(rivals::constraintAnticipation(p.view(), p.system, p.jacobian, p.momentum, 1e-5, 20000), 1e-5,
               "constraint anticipation");
    if (cone.exact) {
      expectSame(rivals::acceleratedProjectedGradient(p.view(), 1e-6, 20000), 1e-6, "accelerated projected gradient");
    }
  }
}

}  // namespace
}  // namespace palpate
