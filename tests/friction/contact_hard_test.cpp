// Problems that are hard to solve: redundant contacts on flat faces, weights of 1:100 on each other, heaps.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "shared/coupled_problems.h"
#include "shared/solved_contacts.h"

namespace palpate {
namespace {

using namespace test;

/// Residual of a cold solve, relative to the largest velocity.
double solvedTo(const OwnedProblem& p, const ContactSolverSettings& settings = {}) {
  const Solution s = solve(p, settings);
  EXPECT_TRUE(s.lambda.allFinite());
  const double residual = contactResidual(p.view(), s.lambda) / velocityScale(p);
  EXPECT_EQ(s.report.converged, residual <= std::max(settings.tolerance, settings.acceptable) * (1.0 + 1e-6));
  return residual;
}

TEST(HardContact, FlatFacesAndWeightsOfOneToHundred) {
  for (const Coupling kind : {Coupling::flat, Coupling::heavy_on_light, Coupling::light_on_heavy, Coupling::alternating,
                              Coupling::rigid_stack, Coupling::wedge}) {
    for (const FrictionCone& cone : bothCones()) {
      for (const double mu : {0.3, 0.8}) {
        CoupledScene scene;
        scene.kind = kind;
        scene.mu = mu;
        for (scene.seed = 1; scene.seed <= 3; ++scene.seed) {
          EXPECT_LE(solvedTo(scene.make(cone)), 1e-9)
              << "kind " << static_cast<int>(kind) << " exact " << cone.exact << " mu " << mu << " seed " << scene.seed;
        }
      }
    }
  }
}

TEST(HardContact, FiveHundredRedundantContacts) {
  for (const Coupling kind : {Coupling::flat, Coupling::alternating}) {
    for (const FrictionCone& cone : bothCones()) {
      CoupledScene scene;
      scene.kind = kind;
      scene.contacts = 500;
      ContactSolverSettings settings;
      const double reached = kind == Coupling::flat ? 1e-6 : 1e-5;  // of 1:100, within the default work: 2e-6
      settings.tolerance = 0.9 * reached;
      EXPECT_LE(solvedTo(scene.make(cone), settings), reached)
          << "kind " << static_cast<int>(kind) << " exact " << cone.exact;
    }
  }
}

/// Soft bodies that press on each other and on walls from all sides, with patches of redundant points.
CoupledProblem heap(unsigned seed, const FrictionCone& cone) {
  constexpr int bodies = 8, patches = 18, points = 5;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  Assembly a;
  const Lattice l;
  for (int b = 0; b < bodies; ++b)
    a.addSoft(l, {0.1 * normal(random), 0.1 * normal(random), -0.3 + 0.05 * normal(random)});
  for (int k = 0; k < patches; ++k) {
    const int above = k % bodies, below = k < bodies ? k - 1 : static_cast<int>(uniform(random) * bodies);
    if (above == below) continue;
    const Vec3 up(normal(random), normal(random), std::abs(normal(random)) + 0.3);
    const double x = uniform(random), y = uniform(random), gap = std::max(0.0, 2e-4 * normal(random));
    for (int i = 0; i < points; ++i) {
      const double u = x + uniform(random), v = y + uniform(random);
      const auto other = below < 0 || k % 3 == 0 ? Assembly::Point{} : a.onFace(below, l, u, v, l.nz - 1);
      a.addContact(a.onFace(above, l, u, v, 0), other, up.normalized(), -gap / l.step, 0.4);
    }
  }
  return a.make(cone);
}

TEST(HardContact, HeapsAreSolvedWithinAStepsBudget) {
  ContactSolverSettings settings;  // those of a step
  settings.acceptable = 1e-6;
  settings.max_operations = 1e10;
  for (const FrictionCone& cone : bothCones()) {
    for (unsigned seed = 1; seed <= 8; ++seed) {
      EXPECT_LE(solvedTo(heap(seed, cone), settings), 1e-6) << "exact " << cone.exact << " seed " << seed;
    }
  }
}

}  // namespace
}  // namespace palpate
