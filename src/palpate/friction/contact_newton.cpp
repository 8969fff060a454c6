// Newton steps of ContactSolver on the rows that the contacts' states leave free.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "palpate/friction/contact_solver.h"

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr double kFarLess = 1e-3;
constexpr double kUnbounded = std::numeric_limits<double>::infinity();

}  // namespace

/// Free directions and test rows of the closed contacts, sticking ones first; lambda is moved onto what the states
/// allow.
void ContactSolver::chooseFree(const ContactProblem& problem) {
  free_.clear();
  int stick_unknowns = 0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    if (status_[i].state != ContactState::stick) continue;
    FreeDirections& f = free_.emplace_back();
    f.contact = static_cast<int>(i);
    f.dims = 3;
    f.offset = stick_unknowns;
    f.b.setIdentity();
    f.c.setIdentity();
    stick_unknowns += 3;
  }
  int slip_unknowns = 0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    auto impulse = lambda_.segment<3>(3 * i);
    const ContactStatus status = status_[i];
    if (status.state == ContactState::open) impulse.setZero();
    if (status.state == ContactState::open || status.state == ContactState::stick) continue;
    const double mu = problem.friction[i];
    impulse[0] = std::max(impulse[0], 0.0);
    FreeDirections& f = free_.emplace_back();
    f.contact = static_cast<int>(i);
    f.offset = slip_unknowns;
    f.c(0, 0) = f.b(0, 0) = 1.0;
    f.dims = 1;
    Vec2 along = Vec2::Zero(), across = Vec2::Zero();
    if (status.state == ContactState::vertex) {
      along = corner_[status.index];
    } else if (status.state == ContactState::edge) {
      along = std::cos(std::numbers::pi / problem.cone.facets) * normal_[status.index];
      across = tangent_[status.index];
      f.dims = 2;
    } else if (mu > 0.0) {
      along = heading_[i];
      across = Vec2(-along[1], along[0]);
      f.dims = 2;
    }
    const double offset = status.state == ContactState::edge ? across.dot(impulse.tail<2>()) : 0.0;
    f.b.block<2, 1>(1, 0) = mu * along;
    f.b.block<2, 1>(1, 1) = f.c.block<2, 1>(1, 1) = across;
    impulse.tail<2>() = mu * impulse[0] * along + offset * across;
    slip_unknowns += f.dims;
  }
}

/// On the exact cone the friction direction turns with the velocity: d(e_perp . w_t) has -(e . w_t) dtheta besides.
void ContactSolver::setCurvature(const ContactProblem& problem) {
  if (!problem.cone.exact) return;
  for (FreeDirections& f : free_) {
    if (f.dims != 2) continue;
    const double radius = problem.friction[f.contact] * lambda_[3 * f.contact];
    const double dissipated = std::max(0.0, -heading_[f.contact].dot(w_.segment<2>(3 * f.contact + 1)));
    const double largest = 1e8 * rho_[f.contact];
    f.curvature = dissipated < largest * radius ? dissipated / radius : (dissipated > 0.0 ? largest : 0.0);
  }
}

/// What the states leave of the velocities that should vanish; returns the largest.
double ContactSolver::freeResidual(const ContactProblem& problem) {
  violation_ = w_;
  double worst = 0.0;
  for (FreeDirections& f : free_) {
    violation_[3 * f.contact] -= problem.bias[f.contact];
    if (problem.cone.exact && f.dims == 2) {
      const Vec2& along = heading_[f.contact];
      f.c.col(1) << 0.0, -along[1], along[0];
    }
    const Vec3 w = violation_.segment<3>(3 * f.contact);
    for (int d = 0; d < f.dims; ++d) worst = std::max(worst, std::abs(f.c.col(d).dot(w)));
  }
  return std::isfinite(violation_.sum()) ? worst : kUnbounded;
}

/// Solves with the factor and moves lambda along the free directions.
void ContactSolver::stepFree(const ContactProblem& problem) {
  factor_.solve(free_, violation_, change_);
  for (const FreeDirections& f : free_) {
    auto impulse = lambda_.segment<3>(3 * f.contact);
    const auto change = change_.segment<3>(3 * f.contact);
    if (f.dims == 3) {
      impulse += change;
      continue;
    }
    impulse[0] += change[0];
    const double radius = problem.friction[f.contact] * impulse[0];
    if (f.dims == 2 && problem.cone.exact) {
      // along the cone's tangent plane, then back onto the cone
      Vec2& along = heading_[f.contact];
      const double aside = f.b.col(1).tail<2>().dot(change.tail<2>());
      if (radius > 0.0) along = (radius * along + aside * Vec2(-along[1], along[0])).normalized();
      impulse.tail<2>() = radius * along;
    } else {
      const Vec2 across = f.b.col(1).tail<2>();
      const double aside = f.dims == 2 ? across.dot(impulse.tail<2>() + change.tail<2>()) : 0.0;
      impulse.tail<2>() = impulse[0] * f.b.col(0).tail<2>() + aside * across;
    }
  }
}

/// Repeats the solution with the same factor, which takes the regularization out again and stays near the impulses it
/// came from. True if nothing is left of the velocities that should vanish, or so little that the states are wrong by
/// far more.
bool ContactSolver::solveStates(const ContactProblem& problem, double tolerance) {
  double before = kUnbounded;
  for (int k = 0;; ++k) {
    const double left = freeResidual(problem);
    if (left <= 0.1 * tolerance || (k > 0 && left < kFarLess * residual(problem))) return true;
    if (k == 6 || left > 0.5 * before || !std::isfinite(left)) return false;
    before = left;
    stepFree(problem);
    updateVelocity(problem, lambda_, w_);
  }
}

/// Solves the linear system that the states leave. Proximal: regularized so that redundant contacts do no harm.
bool ContactSolver::newton(const ContactProblem& problem, double tolerance, Work& work) {
  unmoved_ = lambda_;
  chooseFree(problem);
  updateVelocitySince(problem, unmoved_);
  setCurvature(problem);
  if (factored_ != problem.delassus.data()) factor_.forget();
  factored_ = problem.delassus.data();
  const bool found = factor_.prepare(problem.delassus, rho_, free_, may_border_ && !problem.cone.exact);
  work.operations += factor_.operations();
  if (!found) return false;
  if (factor_.bordered()) {
    unmoved_ = lambda_;
    if (solveStates(problem, tolerance)) return true;
    may_border_ = false;
    lambda_ = unmoved_;
    updateVelocity(problem, lambda_, w_);
    const bool again = factor_.prepare(problem.delassus, rho_, free_, false);
    work.operations += factor_.operations();
    if (!again) return false;
  }
  solveStates(problem, tolerance);
  return lambda_.allFinite();
}

}  // namespace palpate
