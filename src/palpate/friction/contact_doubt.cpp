// ContactSolver on the contacts whose states are in doubt.

#include <algorithm>

#include "palpate/friction/contact_solver.h"

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr int kMostRounds = 10;
constexpr double kMostDoubtful = 0.85;  // of the contacts: beyond, the problem is hardly smaller
constexpr double kPartReduced = 0.5;    // of the work that is left, for one reduced problem

}  // namespace

/// Whether contact i, open or sticking, would be something else by where impulse and velocity have come to. What slides
/// always is: in which direction follows from the others.
bool ContactSolver::inDoubt(const ContactProblem& problem, Eigen::Index i, double tolerance) const {
  const Vec3 impulse = augmented(problem, i);
  if (status_[i].state == ContactState::open) return impulse[0] > tolerance;
  if (status_[i].state != ContactState::stick || !(impulse[0] > 0.0)) return true;
  Vec2 point;
  return nearest(problem.cone, problem.friction[i] * impulse[0], impulse.tail<2>(), point).state != ContactState::stick;
}

/// Contacts that are in doubt, beside those that were, and those that stick. @returns false if there are no new ones
bool ContactSolver::findDoubtful(const ContactProblem& problem, double tolerance) {
  bool more = false;
  reduced_.sticking.clear();
  reduced_.doubtful.clear();
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    if (doubted_[i] == 0 && inDoubt(problem, i, tolerance)) {
      doubted_[i] = 1;
      more = true;
    }
    if (doubted_[i] != 0) {
      reduced_.doubtful.push_back(static_cast<int>(i));
    } else if (status_[i].state == ContactState::stick) {
      reduced_.sticking.push_back(static_cast<int>(i));
    }
  }
  return more;
}

/// Rounds from the present impulses and states: contacts in doubt are solved for, with the others sticking or open;
/// who of those then disobeys is in doubt from the next round on.
void ContactSolver::doubtPhase(const ContactProblem& problem, double tolerance, double acceptable, Work& work) {
  doubted_.assign(static_cast<std::size_t>(rho_.size()), 0);
  if (doubtful_solver_.empty()) doubtful_solver_.resize(1);
  ContactSolver& own = doubtful_solver_.front();
  for (int round = 0; round < kMostRounds && work.left() && findDoubtful(problem, tolerance); ++round) {
    const std::vector<int>& doubtful = reduced_.doubtful;
    const double count = static_cast<double>(doubtful.size());
    if (count > kMostDoubtful * static_cast<double>(rho_.size())) return;
    own_lambda_.resize(static_cast<Eigen::Index>(3 * doubtful.size()));
    own_status_.resize(doubtful.size());
    for (std::size_t k = 0; k < doubtful.size(); ++k) {
      own_lambda_.segment<3>(static_cast<Eigen::Index>(3 * k)) = lambda_.segment<3>(3 * doubtful[k]);
      own_status_[k] = status_[doubtful[k]];
      lambda_.segment<3>(3 * doubtful[k]).setZero();
    }
    work.spend(reduced_.operations() + work.product);
    if (!reduced_.form(problem, rho_, lambda_)) return;
    const ContactProblem reduced = reduced_.problem();
    Work part;
    part.begin(count, work.max_iterations - work.iterations, kPartReduced * work.remaining());
    const bool hinted = own.begin(reduced, 1.0, own_lambda_, own_status_);
    own.find(reduced, tolerance, tolerance, acceptable, hinted, part);
    work.operations += part.operations;
    work.iterations += part.iterations;
    reduced_.expand(own.best_.lambda, lambda_);
    for (std::size_t k = 0; k < doubtful.size(); ++k) status_[doubtful[k]] = own.best_.status[k];
    updateVelocity(problem, lambda_, w_);
    if (own.best_.residual > acceptable) return;
  }
  settleStates(problem);
  updateVelocity(problem, lambda_, w_);
  if (keepBest(problem, best_) > tolerance) newtonPhase(problem, tolerance, best_, 4, work);
}

}  // namespace palpate
