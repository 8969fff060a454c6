// Newton steps of ContactSolver on the rows that the contacts' states leave free.

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "palpate/solver/contact_solver.h"
#include "palpate/solver/dense_lu.h"

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;
using MapX = Eigen::Map<MatX>;

constexpr double infinity = std::numeric_limits<double>::infinity();

void grow(std::vector<double, Eigen::aligned_allocator<double>>& buffer, Eigen::Index size) {
  if (buffer.size() < static_cast<std::size_t>(size)) buffer.resize(static_cast<std::size_t>(size));
}

}  // namespace

/// Free directions and test rows of the closed contacts, sticking ones first; lambda is moved onto what the states
/// allow.
void ContactSolver::chooseFree(const ContactProblem& problem) {
  free_.clear();
  stick_unknowns_ = 0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    if (status_[i].state != ContactState::stick) continue;
    Free& f = free_.emplace_back();
    f.contact = static_cast<int>(i);
    f.dims = 3;
    f.offset = stick_unknowns_;
    f.b.setIdentity();
    f.c.setIdentity();
    stick_unknowns_ += 3;
  }
  slip_unknowns_ = 0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    auto impulse = lambda_.segment<3>(3 * i);
    const ContactStatus status = status_[i];
    if (status.state == ContactState::open) impulse.setZero();
    if (status.state == ContactState::open || status.state == ContactState::stick) continue;
    const double mu = problem.friction[i];
    impulse[0] = std::max(impulse[0], 0.0);
    Free& f = free_.emplace_back();
    f.contact = static_cast<int>(i);
    f.offset = slip_unknowns_;
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
    slip_unknowns_ += f.dims;
  }
}

/// On the exact cone the friction direction turns with the velocity: d(e_perp . w_t) has -(e . w_t) dtheta besides.
void ContactSolver::setCurvature(const ContactProblem& problem) {
  if (!problem.cone.exact) return;
  for (Free& f : free_) {
    if (f.dims != 2) continue;
    const double radius = problem.friction[f.contact] * lambda_[3 * f.contact];
    const double dissipated = std::max(0.0, -heading_[f.contact].dot(w_.segment<2>(3 * f.contact + 1)));
    const double largest = 1e8 * rho_[f.contact];
    f.curvature = dissipated < largest * radius ? dissipated / radius : (dissipated > 0.0 ? largest : 0.0);
  }
}

/// Factor of  C^T W B + curvature + regularization rho:  Cholesky of the sticking rows, LU of the rest's Schur
/// complement.
bool ContactSolver::factorize(const ContactProblem& problem, double regularization) {
  const Eigen::Index ns = stick_unknowns_, nv = slip_unknowns_, rows = problem.free.size();
  grow(stick_matrix_, ns * ns);
  grow(right_, ns * nv);
  grow(left_, ns * nv);
  grow(slip_matrix_, nv * nv);
  grow(column_, 2 * rows);
  MapX stick(stick_matrix_.data(), ns, ns), right(right_.data(), ns, nv), left(left_.data(), ns, nv);
  MapX slip(slip_matrix_.data(), nv, nv);
  Eigen::Map<VecX> moved(column_.data(), rows), tested(column_.data() + rows, rows);
  for (const Free& j : free_) {
    if (j.offset + 3 <= ns && j.dims == 3) {
      for (const Free& i : free_) {
        if (i.dims != 3) break;
        stick.block<3, 3>(i.offset, j.offset) = problem.delassus.block<3, 3>(3 * i.contact, 3 * j.contact);
      }
      stick.diagonal().segment<3>(j.offset).array() += regularization * rho_[j.contact];
      continue;
    }
    for (int d = 0; d < j.dims; ++d) {
      const Eigen::Index column = j.offset + d;
      moved = problem.delassus.middleCols<3>(3 * j.contact).lazyProduct(j.b.col(d));
      tested = problem.delassus.middleCols<3>(3 * j.contact).lazyProduct(j.c.col(d));
      for (const Free& i : free_) {
        if (i.dims == 3) {
          right.block<3, 1>(i.offset, column) = moved.segment<3>(3 * i.contact);
          left.block<3, 1>(i.offset, column) = tested.segment<3>(3 * i.contact);
        } else {
          for (int e = 0; e < i.dims; ++e) slip(i.offset + e, column) = i.c.col(e).dot(moved.segment<3>(3 * i.contact));
        }
      }
      slip(column, column) += regularization * rho_[j.contact] + (d == 1 ? j.curvature : 0.0);
    }
  }
  if (ns > 0) {
    Eigen::Ref<MatX> in_place(stick);
    const Eigen::LLT<Eigen::Ref<MatX>> cholesky(in_place);
    if (cholesky.info() != Eigen::Success) return false;
  }
  if (nv == 0) return true;
  if (ns > 0) {
    const auto lower = stick.triangularView<Eigen::Lower>();
    lower.solveInPlace(right);
    lower.solveInPlace(left);
    slip.noalias() -= left.transpose() * right;
  }
  return luInPlace(slip, pivots_);
}

/// Minus what the states leave of the rows that should vanish, into rhs_; returns the largest.
double ContactSolver::freeResidual(const ContactProblem& problem) {
  const Eigen::Index unknowns = stick_unknowns_ + slip_unknowns_;
  rhs_.resize(problem.free.size());  // as many as there can be, so that it keeps its size
  for (const Free& f : free_) {
    const int offset = f.dims == 3 ? f.offset : stick_unknowns_ + f.offset;
    Vec3 w = w_.segment<3>(3 * f.contact);
    w[0] -= problem.bias[f.contact];
    if (problem.cone.exact && f.dims == 2) {
      const Vec2& along = heading_[f.contact];
      rhs_[offset] = -w[0];
      rhs_[offset + 1] = along[1] * w[1] - along[0] * w[2];
    } else {
      for (int d = 0; d < f.dims; ++d) rhs_[offset + d] = -f.c.col(d).dot(w);
    }
  }
  return unknowns > 0 ? rhs_.head(unknowns).lpNorm<Eigen::Infinity>() : 0.0;
}

/// Solves with the factor for rhs_ and moves lambda along the free directions.
void ContactSolver::stepFree(const ContactProblem& problem) {
  const Eigen::Index ns = stick_unknowns_, nv = slip_unknowns_;
  const Eigen::Map<const MatX> stick(stick_matrix_.data(), ns, ns), right(right_.data(), ns, nv),
      left(left_.data(), ns, nv), slip(slip_matrix_.data(), nv, nv);
  auto sticking = rhs_.head(ns);
  auto slipping = rhs_.segment(ns, nv);
  if (ns > 0) stick.triangularView<Eigen::Lower>().solveInPlace(sticking);
  if (nv > 0) {
    if (ns > 0) slipping.noalias() -= left.transpose() * sticking;
    luSolve(slip, pivots_, slipping);
    if (ns > 0) sticking.noalias() -= right * slipping;
  }
  if (ns > 0) stick.transpose().triangularView<Eigen::Upper>().solveInPlace(sticking);
  for (const Free& f : free_) {
    auto impulse = lambda_.segment<3>(3 * f.contact);
    const auto change = rhs_.segment(f.dims == 3 ? f.offset : stick_unknowns_ + f.offset, f.dims);
    if (f.dims == 3) {
      impulse += change;
    } else if (!problem.cone.exact || f.dims == 1) {
      for (int d = 0; d < f.dims; ++d) impulse += change[d] * f.b.col(d);
    } else {
      // along the cone's tangent plane, then back onto the cone
      Vec2& along = heading_[f.contact];
      impulse[0] += change[0];
      const double radius = problem.friction[f.contact] * impulse[0];
      if (radius > 0.0) along = (radius * along + change[1] * Vec2(-along[1], along[0])).normalized();
      impulse.tail<2>() = radius * along;
    }
  }
}

/// Solves the linear system that the states leave. Proximal: regularised so that redundant contacts do no harm, then
/// repeated with the same factor, which takes the regularization out again and stays near the impulses it came from.
bool ContactSolver::newton(const ContactProblem& problem, double tolerance, Work& work) {
  chooseFree(problem);
  updateVelocity(problem, lambda_, w_);
  setCurvature(problem);
  double regularization = 1e-9;
  const double stick = stick_unknowns_, slip = slip_unknowns_;
  const double cost = stick * stick * stick / 3.0 + 2.0 * stick * slip * slip + 2.0 * stick * stick * slip +
                      2.0 / 3.0 * slip * slip * slip + 2.0 * slip * work.rows;
  work.operations += cost;
  while (!factorize(problem, regularization)) {
    work.operations += cost;
    regularization *= 100.0;
    if (regularization > 1.0) return false;
  }
  double before = infinity;
  for (int k = 0; k < 6; ++k) {
    const double left = freeResidual(problem);
    if (left <= 0.1 * tolerance || left > 0.5 * before || !std::isfinite(left)) break;
    before = left;
    stepFree(problem);
    updateVelocity(problem, lambda_, w_);
  }
  return lambda_.allFinite();
}

}  // namespace palpate
