#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "palpate/friction/contact_solver.h"
#include "shared/contact_problems.h"

namespace palpate::test {

inline FrictionCone exactCone() { return {true, 8}; }
inline FrictionCone polygon(int facets) { return {false, facets}; }
inline std::vector<FrictionCone> bothCones() { return {polygon(8), exactCone()}; }

/// Largest velocity in a problem, which tolerances are relative to [m/s].
inline double velocityScale(const OwnedProblem& p) {
  return std::max(p.free.lpNorm<Eigen::Infinity>(), p.bias.lpNorm<Eigen::Infinity>());
}

struct Solution {
  VecX lambda;
  std::vector<ContactStatus> status;
  ContactSolverReport report;
  VecX w;  ///< W lambda + free
};

/// By a new solver, without a warm start.
inline Solution solve(const OwnedProblem& p, const ContactSolverSettings& settings = {}) {
  Solution s;
  ContactSolver solver;
  s.report = solver.solve(p.view(), settings, s.lambda, s.status);
  s.w = p.delassus * s.lambda + p.free;
  return s;
}

}  // namespace palpate::test
