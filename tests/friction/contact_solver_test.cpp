#include "palpate/friction/contact_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>

#include "shared/contact_problems.h"
#include "shared/count_allocations.h"
#include "shared/solved_contacts.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kPi = std::numbers::pi;
constexpr double kTolerance = 1e-10;

/// One contact of a point mass: W = 1 / mass.
OwnedProblem pointMass(double mass, double mu, const Vec3& free, const FrictionCone& cone) {
  OwnedProblem p;
  p.delassus = MatX::Identity(3, 3) / mass;
  p.free.resize(3);
  for (int k = 0; k < 3; ++k) p.free[k] = free[k];
  p.bias = VecX::Zero(1);
  p.friction = VecX::Constant(1, mu);
  p.cone = cone;
  return p;
}

/// Every property of a solution that follows from the contact law and can be read off without the solver's own terms.
void expectContactLaw(const OwnedProblem& p, const Solution& s, const std::string& what) {
  SCOPED_TRACE(what);
  const double slack = 1e-9 * velocityScale(p);
  EXPECT_TRUE(s.report.converged) << s.report.iterations << " iterations, residual " << s.report.residual;
  EXPECT_LE(contactResidual(p.view(), s.lambda), kTolerance * velocityScale(p) * 1.01);
  ASSERT_EQ(s.status.size(), static_cast<std::size_t>(p.contacts()));
  for (int i = 0; i < p.contacts(); ++i) {
    SCOPED_TRACE(i);
    const ContactStatus& status = s.status[i];
    const double n = s.lambda[3 * i], mu = p.friction[i], gap = s.w[3 * i] - p.bias[i];
    const Eigen::Vector2d t = s.lambda.segment<2>(3 * i + 1), v = s.w.segment<2>(3 * i + 1);
    const double rounding = 1e-12 * mu * n;
    EXPECT_GE(n, 0.0);
    EXPECT_GE(gap, -slack);
    EXPECT_LE(t.norm(), mu * n + rounding);
    EXPECT_LE(t.dot(v), slack * mu * n);
    EXPECT_EQ(status.state == ContactState::open, n == 0.0);
    if (n > 0.0) {
      EXPECT_LE(std::abs(gap), slack);
    }
    if (n > 0.0 && mu == 0.0) {
      EXPECT_EQ(status.state, ContactState::slide);
    }
    if (mu == 0.0) {
      EXPECT_EQ(t.norm(), 0.0);
    }
    if (status.state == ContactState::stick) {
      EXPECT_LE(v.norm(), slack);
    }
    if (p.cone.exact) {
      EXPECT_TRUE(status.state != ContactState::edge && status.state != ContactState::vertex);
      if (status.state == ContactState::stick) {
        EXPECT_LT(t.norm(), mu * n);
      }
      if (status.state == ContactState::slide) {
        EXPECT_NEAR(t.norm(), mu * n, rounding);
      }
      continue;
    }
    const int facets = p.cone.facets;
    double depth = 1e300;
    for (int k = 0; k < facets; ++k) {
      depth = std::min(depth, mu * n * std::cos(kPi / facets) - t.dot(edgeNormal(k, facets).tail<2>()));
    }
    EXPECT_GE(depth, -rounding);
    if (status.state == ContactState::stick) {
      EXPECT_GT(depth, 0.0);
    }
    if (status.state == ContactState::vertex) {
      EXPECT_LE((t - mu * n * vertexDirection(status.index, facets).tail<2>()).norm(), rounding);
    }
    if (status.state == ContactState::edge) {
      EXPECT_NEAR(t.dot(edgeNormal(status.index, facets).tail<2>()), mu * n * std::cos(kPi / facets), rounding);
      EXPECT_LT(std::abs(t.dot(edgeTangent(status.index, facets).tail<2>())),
                mu * n * std::sin(kPi / facets) + rounding);
    }
  }
}

TEST(ConeDirections, AreThoseOfTheInscribedPolygon) {
  for (int facets : {3, 4, 8, 13}) {
    EXPECT_LT((vertexDirection(0, facets) - Vec3(0, 1, 0)).norm(), 1e-15);
    for (int k = -1; k <= facets; ++k) {
      const Vec3 a = vertexDirection(k, facets), b = vertexDirection(k + 1, facets);
      EXPECT_NEAR(std::atan2(a.cross(b)[0], a.dot(b)), 2 * kPi / facets, 1e-14);
      EXPECT_NEAR(edgeNormal(k, facets).dot(a), std::cos(kPi / facets), 1e-14);
      EXPECT_NEAR(edgeNormal(k, facets).dot(b), std::cos(kPi / facets), 1e-14);
      EXPECT_LT((edgeTangent(k, facets) - (b - a).normalized()).norm(), 1e-13);
    }
  }
}

TEST(ContactSolver, OpenContactStaysOpen) {
  for (const FrictionCone& cone : bothCones()) {
    const Solution s = solve(pointMass(2.0, 0.5, {0.1, 1, 1}, cone));
    EXPECT_TRUE(s.report.converged);
    EXPECT_EQ(s.status[0].state, ContactState::open);
    EXPECT_EQ(s.lambda.norm(), 0.0);
  }
}

TEST(ContactSolver, SticksInsideTheCone) {
  for (const FrictionCone& cone : bothCones()) {
    const OwnedProblem p = pointMass(2.0, 0.5, {-1.0, 0.2, -0.3}, cone);
    const Solution s = solve(p);
    EXPECT_EQ(s.status[0].state, ContactState::stick);
    EXPECT_LT((s.lambda - Vec3(2.0, -0.4, 0.6)).norm(), 1e-12);
  }
}

TEST(ContactSolver, BiasIsTheLeastNormalVelocity) {
  OwnedProblem p = pointMass(2.0, 0.5, {-1.0, 0.0, 0.0}, exactCone());
  p.bias[0] = -0.25;
  EXPECT_NEAR(solve(p).lambda[0], 1.5, 1e-12);
}

TEST(ContactSolver, SlidesAgainstTheVelocityOnTheExactCone) {
  for (int k = 0; k < 37; ++k) {
    const double angle = 0.17 * k;
    const OwnedProblem p = pointMass(2.0, 0.5, {-1.0, 3 * std::cos(angle), 3 * std::sin(angle)}, exactCone());
    const Solution s = solve(p);
    EXPECT_EQ(s.status[0].state, ContactState::slide);
    EXPECT_LT((s.lambda - Vec3(2.0, -std::cos(angle), -std::sin(angle))).norm(), 1e-10);
  }
}

TEST(ContactSolver, PicksTheVertexOfMostDissipation) {
  const int facets = 8;
  for (int k = 0; k < facets; ++k) {
    for (double off : {-0.35, 0.0, 0.35}) {  // of the velocity, fast enough to stay within half a sector, 0.39
      const double angle = 2 * kPi * k / facets + kPi + off;
      const OwnedProblem p = pointMass(2.0, 0.5, {-1.0, 30 * std::cos(angle), 30 * std::sin(angle)}, polygon(facets));
      const Solution s = solve(p);
      EXPECT_EQ(s.status[0], (ContactStatus{ContactState::vertex, k}));
      EXPECT_LT((s.lambda - (Vec3(2, 0, 0) + vertexDirection(k, facets))).norm(), 1e-12);
    }
  }
}

TEST(ContactSolver, EndsOnTheEdgeWhereOneDirectionStops) {
  // free tangential velocity just beyond the polygon, along an edge's normal: the contact slips along the normal and
  // not along the edge
  const int facets = 8;
  for (int k = 0; k < facets; ++k) {
    const Vec3 m = edgeNormal(k, facets), e = edgeTangent(k, facets);
    const Vec3 free = Vec3(-1, 0, 0) - 0.6 * m - 0.1 * e;
    const Solution s = solve(pointMass(2.0, 0.5, free, polygon(facets)));
    EXPECT_EQ(s.status[0], (ContactStatus{ContactState::edge, k}));
    const Vec3 expected = Vec3(2, 0, 0) + std::cos(kPi / facets) * m + 0.2 * e;
    EXPECT_LT((s.lambda - expected).norm(), 1e-12);
  }
}

/// A block of 3 kg on an incline for one step from rest: gravity h g (-cos, sin) in the incline's frame.
double slipVelocity(double mu, double slope, const FrictionCone& cone) {
  const double impulse = 9.81 * 0.01;
  const Solution s = solve(pointMass(3.0, mu, {-impulse * std::cos(slope), impulse * std::sin(slope), 0}, cone));
  EXPECT_TRUE(s.report.converged);
  return s.w[1];
}

TEST(ContactSolver, InclineSlipsAtTheFrictionAngle) {
  for (const FrictionCone& cone : bothCones()) {
    for (double mu : {0.1, 0.5, 1.0, 3.0}) {
      EXPECT_LT(std::abs(slipVelocity(mu, std::atan(mu * (1 - 1e-6)), cone)), 1e-13);
      const double above = std::atan(mu * (1 + 1e-6));
      const double expected = 9.81 * 0.01 * (std::sin(above) - mu * std::cos(above));
      EXPECT_NEAR(slipVelocity(mu, above, cone), expected, 1e-4 * expected);
    }
  }
}

TEST(ContactSolver, RandomProblems) {
  for (const FrictionCone& cone : {polygon(8), exactCone(), polygon(4), polygon(5)}) {
    for (unsigned seed = 0; seed < 40; ++seed) {
      const int m = 1 + static_cast<int>(seed) % 20;
      const OwnedProblem p = randomProblem(m, 4 * m, 1.0, seed, cone);
      expectContactLaw(p, solve(p), "seed " + std::to_string(seed) + " facets " + std::to_string(cone.facets));
    }
  }
}

TEST(ContactSolver, MassRatioOfOneToHundred) {
  for (const FrictionCone& cone : bothCones()) {
    for (unsigned seed = 0; seed < 10; ++seed) {
      const OwnedProblem p = randomProblem(25, 100, 100.0, seed, cone);
      expectContactLaw(p, solve(p), "seed " + std::to_string(seed));
    }
  }
}

TEST(ContactSolver, RedundantContacts) {
  for (const FrictionCone& cone : bothCones()) {
    for (unsigned seed = 0; seed < 4; ++seed) {
      const OwnedProblem p = randomProblem(30, 24, 10.0, seed, cone);
      expectContactLaw(p, solve(p), "rank 24 of 90, seed " + std::to_string(seed));
    }
    SoftBar bar;
    bar.bumpiness = 0.0;  // flat: all of the points are affine in their nodes, and many hold weakly
    for (double drag : {0.0, 0.05}) {
      bar.drag = drag;
      const OwnedProblem p = bar.make(90, false, 3, cone);
      expectContactLaw(p, solve(p), "90 points on 25 nodes");
    }
  }
}

TEST(ContactSolver, DuplicatedContactsShareTheLoad) {
  for (const FrictionCone& cone : bothCones()) {
    SoftBar bar;
    const OwnedProblem once = bar.make(0, true, 5, cone);
    const int m = once.contacts();
    OwnedProblem twice = once;
    twice.delassus = once.delassus.replicate(2, 2);
    twice.free = once.free.replicate(2, 1);
    twice.bias = once.bias.replicate(2, 1);
    twice.friction = once.friction.replicate(2, 1);
    const Solution a = solve(once), b = solve(twice);
    expectContactLaw(once, a, "once");
    expectContactLaw(twice, b, "twice");
    EXPECT_LT((b.w.head(3 * m) - a.w).norm(), 1e-8 * velocityScale(once));
    EXPECT_LT((b.lambda.head(3 * m) + b.lambda.tail(3 * m) - a.lambda).norm(), 1e-6 * a.lambda.norm());
  }
}

TEST(ContactSolver, HundredsOfContacts) {
  SoftBar bar;
  bar.nx = 10;
  bar.ny = 8;
  bar.nz = 2;
  bar.bumpiness = 1e-4;
  for (const FrictionCone& cone : bothCones()) {
    const OwnedProblem p = bar.make(240, false, 7, cone);
    expectContactLaw(p, solve(p), "240 points on 80 nodes");
  }
}

TEST(ContactSolver, VelocityDoesNotDependOnTheOrderOfContacts) {
  for (const FrictionCone& cone : bothCones()) {
    const OwnedProblem p = SoftBar{}.make(60, false, 11, cone);
    const int m = p.contacts();
    std::vector<int> order(m);
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), std::mt19937(5));
    std::vector<int> rows;
    for (int i : order) rows.insert(rows.end(), {3 * i, 3 * i + 1, 3 * i + 2});
    OwnedProblem q = p;
    q.delassus = p.delassus(rows, rows);
    q.free = p.free(rows);
    q.bias = p.bias(order);
    q.friction = p.friction(order);
    const Solution a = solve(p), b = solve(q);
    expectContactLaw(q, b, "permuted");
    EXPECT_LT((a.w(rows) - b.w).lpNorm<Eigen::Infinity>(), 1e-7 * velocityScale(p));
  }
}

TEST(ContactSolver, WarmStartFromTheSolutionIsIdempotent) {
  for (const FrictionCone& cone : bothCones()) {
    for (int points : {0, 90}) {
      const OwnedProblem p = SoftBar{}.make(points, points == 0, 13, cone);
      const Solution first = solve(p);
      ContactSolver solver;
      VecX lambda = first.lambda;
      std::vector<ContactStatus> status = first.status;
      const ContactSolverReport report = solver.solve(p.view(), {}, lambda, status);
      EXPECT_TRUE(report.converged);
      EXPECT_EQ(report.iterations, 0);
      EXPECT_LT((lambda - first.lambda).norm(), 1e-14 * first.lambda.norm());
      EXPECT_EQ(status, first.status);
    }
  }
}

TEST(ContactSolver, WarmStartOfAnotherStepSavesWork) {
  for (const FrictionCone& cone : bothCones()) {
    SoftBar bar;
    const Solution before = solve(bar.make(0, true, 17, cone));
    bar.drag *= 1.02;
    bar.press *= 1.01;
    const OwnedProblem p = bar.make(0, true, 17, cone);
    Solution s = before;
    ContactSolver solver;
    s.report = solver.solve(p.view(), {}, s.lambda, s.status);
    s.w = p.delassus * s.lambda + p.free;
    expectContactLaw(p, s, "warm");
    EXPECT_LE(s.report.iterations, 4);
  }
}

// What is left for some contacts, while the others keep the states that they have in the solution, has the same
// solution; and that leads back to the impulses of all.
TEST(ReducedContacts, HaveTheSolutionOfTheWhole) {
  for (const FrictionCone& cone : bothCones()) {
    for (const int points : {0, 40}) {  // those of a bar's lower side; more, redundant
      SCOPED_TRACE(points);
      SoftBar bar;
      bar.drag = 0.0;
      bar.press = 0.2;
      bar.mu = 2.0;
      const OwnedProblem p = bar.make(points, points == 0, 41, cone);
      const Solution s = solve(p);
      ReducedContacts reduced;
      VecX lambda = s.lambda, own(0), rho(p.contacts());
      int open = 0;
      for (int i = 0; i < p.contacts(); ++i) {
        rho[i] = impulseScale(p.view(), i);
        const bool doubt = s.status[i].state != ContactState::open && s.status[i].state != ContactState::stick;
        if (doubt || i % 3 == 0) {
          own.conservativeResize(own.size() + 3);
          own.tail<3>() = s.lambda.segment<3>(3 * i);
          lambda.segment<3>(3 * i).setZero();
          reduced.doubtful.push_back(i);
        } else if (s.status[i].state == ContactState::stick) {
          lambda.segment<3>(3 * i) *= 0.9;  // where they change from does not matter
          reduced.sticking.push_back(i);
        } else {
          ++open;
        }
      }
      EXPECT_GT(reduced.sticking.size(), 3U);
      ASSERT_TRUE(reduced.form(p.view(), rho, lambda));
      EXPECT_LT(contactResidual(reduced.problem(), own), 1e-8 * velocityScale(p)) << open << " open";
      reduced.expand(own, lambda);
      EXPECT_LT(contactResidual(p.view(), lambda), 1e-8 * velocityScale(p));
      EXPECT_LT((p.delassus * (lambda - s.lambda)).norm(), 1e-7 * velocityScale(p));
    }
  }
}

// A few places of many are hit: what they and their neighbors do is solved for, not all.
TEST(ContactSolver, FewThatChangeAreSolvedApart) {
  for (const FrictionCone& cone : bothCones()) {
    SoftBar bar;
    bar.drag = 0.0;
    OwnedProblem p = bar.make(100, false, 43, cone);
    const Solution rest = solve(p);
    for (const int hit : {7, 30, 31, 77}) {
      p.free.segment<3>(3 * hit) += velocityScale(p) * Vec3(-1.0, 0.5, -0.3);
    }
    Solution warm = rest;
    ContactSolver solver;
    warm.report = solver.solve(p.view(), {}, warm.lambda, warm.status);
    warm.w = p.delassus * warm.lambda + p.free;
    expectContactLaw(p, warm, "hit");
    EXPECT_NE(warm.status, rest.status);
    EXPECT_LT(3.0 * warm.report.operations, solve(p).report.operations) << warm.report.iterations;
  }
}

TEST(ContactSolver, NonsenseAsWarmStartDoesNoHarm) {
  for (const FrictionCone& cone : bothCones()) {
    const OwnedProblem p = SoftBar{}.make(0, true, 19, cone);
    const Solution reference = solve(p);
    for (ContactState state : {ContactState::stick, ContactState::slide, ContactState::edge, ContactState::vertex}) {
      Solution s;
      s.lambda = VecX::LinSpaced(3 * p.contacts(), -100.0, 50.0);
      s.status.assign(p.contacts(), {state, 1000});
      ContactSolver solver;
      s.report = solver.solve(p.view(), {}, s.lambda, s.status);
      s.w = p.delassus * s.lambda + p.free;
      expectContactLaw(p, s, "nonsense");
      EXPECT_LT((s.w - reference.w).norm(), 1e-7 * velocityScale(p));
    }
  }
}

TEST(ContactSolver, IsDeterministic) {
  for (const FrictionCone& cone : bothCones()) {
    const OwnedProblem p = SoftBar{}.make(90, false, 23, cone);
    const OwnedProblem other = SoftBar{}.make(120, false, 24, cone);
    const Solution a = solve(p);
    ContactSolver used;  // its workspace has seen another problem
    Solution b;
    used.solve(other.view(), {}, b.lambda, b.status);
    b = {};
    used.solve(p.view(), {}, b.lambda, b.status);
    EXPECT_EQ(a.lambda, b.lambda);
    EXPECT_EQ(a.status, b.status);
  }
}

TEST(ContactSolver, WithoutFrictionIsTheSameForBothCones) {
  OwnedProblem p = SoftBar{}.make(0, true, 29, polygon(8));
  p.friction.setZero();
  const Solution a = solve(p);
  expectContactLaw(p, a, "polygon");
  p.cone = exactCone();
  const Solution b = solve(p);
  expectContactLaw(p, b, "exact");
  EXPECT_EQ(a.lambda, b.lambda);
}

TEST(ContactSolver, ManyFacetsApproachTheExactCone) {
  const OwnedProblem round = SoftBar{}.make(0, true, 31, exactCone());
  const Solution exact = solve(round);
  double before = 1e300;
  for (int facets : {4, 16, 64}) {
    OwnedProblem p = round;
    p.cone = polygon(facets);
    const Solution s = solve(p);
    expectContactLaw(p, s, std::to_string(facets) + " facets");
    const double distance = (s.w - exact.w).norm() / exact.w.norm();
    EXPECT_LT(distance, 0.5 * before);
    before = distance;
  }
  EXPECT_LT(before, 0.02);
}

TEST(ContactSolver, RodThatJamsDoesNotHang) {
  // Painleve: a slender rod whose contact couples normal and tangential so strongly that sliding impulses fail
  for (const FrictionCone& cone : bothCones()) {
    for (double coupling : {0.5, 0.9, 0.99}) {
      for (double mu : {0.5, 1.5, 5.0, 100.0}) {
        for (double slip : {-1.0, 1.0}) {
          OwnedProblem p = pointMass(1.0, mu, {-0.01, slip, 0.2}, cone);
          p.delassus(0, 1) = p.delassus(1, 0) = coupling;
          expectContactLaw(p, solve(p), "mu " + std::to_string(mu) + " coupling " + std::to_string(coupling));
        }
      }
    }
  }
}

TEST(ContactSolver, ImpossibleContactReportsSoAndEnds) {
  for (const FrictionCone& cone : bothCones()) {
    OwnedProblem p = pointMass(1.0, 0.5, {-1, 0, 0}, cone);
    p.delassus.setZero();  // nothing can move, yet the contact must open
    const Solution s = solve(p);
    EXPECT_FALSE(s.report.converged);
    EXPECT_GE(s.report.residual, 0.5);
    EXPECT_TRUE(s.lambda.allFinite());
  }
}

TEST(ContactSolver, InputThatIsNotFiniteGivesZeroImpulses) {
  for (const FrictionCone& cone : bothCones()) {
    for (double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      for (int where = 0; where < 4; ++where) {
        OwnedProblem p = randomProblem(5, 20, 1.0, 1, cone);
        if (where == 0) p.delassus(3, 4) = bad;
        if (where == 1) p.free[7] = bad;
        if (where == 2) p.bias[2] = bad;
        if (where == 3) p.friction[2] = bad;
        Solution s;
        s.lambda.setOnes(15);
        ContactSolver solver;
        s.report = solver.solve(p.view(), {}, s.lambda, s.status);
        EXPECT_FALSE(s.report.converged);
        EXPECT_EQ(s.lambda, VecX::Zero(15));
        EXPECT_EQ(s.status, std::vector<ContactStatus>(5));
      }
    }
    const OwnedProblem p = randomProblem(5, 20, 1.0, 1, cone);
    Solution s;
    s.lambda.setConstant(15, std::numeric_limits<double>::quiet_NaN());
    ContactSolver solver;
    EXPECT_TRUE(solver.solve(p.view(), {}, s.lambda, s.status).converged) << "a bad warm start is dropped";
  }
}

TEST(ContactSolver, AllocatesNothingInSteadyState) {
  if (!test::kCountsMalloc) GTEST_SKIP() << "malloc belongs to a sanitizer here";
  for (const FrictionCone& cone : bothCones()) {
    SoftBar bar;
    bar.mu = 1.0;
    const OwnedProblem p = bar.make(30, false, 37, cone);
    ContactSolver solver;
    Solution s;
    solver.solve(p.view(), {}, s.lambda, s.status);  // sizes the workspace
    const ContactProblem problem = p.view();
    const int count = test::allocationsIn([&] {
      for (int k = 0; k < 3; ++k) {
        s.lambda.setZero();
        std::fill(s.status.begin(), s.status.end(), ContactStatus{});
        solver.solve(problem, {}, s.lambda, s.status);
        solver.solve(problem, {}, s.lambda, s.status);
      }
    });
    EXPECT_EQ(count, 0);
  }
}

TEST(ContactSolver, NoContacts) {
  OwnedProblem p;
  const Solution s = solve(p);
  EXPECT_TRUE(s.report.converged);
  EXPECT_EQ(s.lambda.size(), 0);
}

TEST(ContactSolver, RejectsWhatTheCallerGotWrong) {
  ContactSolver solver;
  VecX lambda;
  std::vector<ContactStatus> status;
  OwnedProblem p = randomProblem(3, 12, 1.0, 1, polygon(2));
  EXPECT_THROW(solver.solve(p.view(), {}, lambda, status), std::invalid_argument);
  p.cone = polygon(4);
  p.friction[1] = -0.1;
  EXPECT_THROW(solver.solve(p.view(), {}, lambda, status), std::invalid_argument);
  p.friction.resize(2);
  EXPECT_THROW(solver.solve(p.view(), {}, lambda, status), std::invalid_argument);
}

TEST(ContactResidual, MeasuresKnownViolations) {
  const OwnedProblem p = pointMass(1.0, 0.5, {-1.0, 3.0, 0.0}, polygon(8));
  EXPECT_NEAR(contactResidual(p.view(), Vec3(1.0, -0.5, 0.0)), 0.0, 1e-14);
  EXPECT_NEAR(contactResidual(p.view(), Vec3(0.0, 0.0, 0.0)), 1.0, 1e-14);    // approaches at 1 m/s
  EXPECT_NEAR(contactResidual(p.view(), Vec3(1.0, 0.0, 0.0)), 0.5, 1e-14);    // slides without friction
  EXPECT_NEAR(contactResidual(p.view(), Vec3(1.0, -0.7, 0.0)), 0.2, 1e-14);   // outside the cone
  EXPECT_NEAR(contactResidual(p.view(), Vec3(1.3, -0.65, 0.0)), 0.3, 1e-14);  // pushes while it separates
  // the round cone's solution is outside the polygon, off its vertices
  OwnedProblem q = pointMass(1.0, 0.5, Vec3(-1, 0, 0) - 3.0 * edgeNormal(0, 8), exactCone());
  const VecX round = Vec3(1, 0, 0) + 0.5 * edgeNormal(0, 8);
  EXPECT_NEAR(contactResidual(q.view(), round), 0.0, 1e-14);
  q.cone = polygon(8);
  EXPECT_GT(contactResidual(q.view(), round), 0.03);
}

}  // namespace
}  // namespace palpate
