#pragma once

#include <vector>

#include "palpate/friction/contact_problem.h"
#include "palpate/linear/aligned_buffer.h"
#include "palpate/math/types.h"

namespace palpate {

/// The problem that some contacts, those in doubt, leave to be solved while others stick and the rest are open: with
/// W by blocks of those that stick (s) and those in doubt (d), S = W_ss + epsilon rho, and impulses from which the
/// sticking ones change,
///   W' = W_dd - W_ds S^-1 W_sd,   free' = w_d - W_ds S^-1 (w_s - bias_s),   w the velocity without the doubtful ones
/// (docs/contact-solver.md). Owns its workspace, which grows on demand and is reused.
class ReducedContacts {
 public:
  /// Which of the m contacts stick and which are in doubt, increasing; the lists may be written before form().
  std::vector<int> sticking, doubtful;

  /// @param rho     [m] impulse times this compares with velocity [1/kg]
  /// @param lambda  impulses [N s], 3m: of the sticking contacts where they change from, zero for those that are open
  /// @return false if there is no factor of S
  bool form(const ContactProblem& whole, const VecX& rho, const VecX& lambda);
  /// As formed; lives as long as nothing is formed anew.
  ContactProblem problem() const;
  /// The impulses of all contacts that go with those in doubt.
  /// @param own     of the contacts in doubt [N s]
  /// @param lambda  as given to form(); out, with `own` and what they make of those that stick
  void expand(const VecX& own, VecX& lambda);
  /// What form() comes to.
  double operations() const;

 private:
  Eigen::Index stickingRows() const { return static_cast<Eigen::Index>(3 * sticking.size()); }
  Eigen::Index doubtfulRows() const { return static_cast<Eigen::Index>(3 * doubtful.size()); }

  FrictionCone cone_;
  AlignedBuffer factor_, coupling_, matrix_;       ///< Cholesky factor L of S, L^-1 W_sd, W'
  AlignedBuffer shares_;                           ///< workspace of a velocity
  VecX velocity_, rest_, free_, bias_, friction_;  ///< [3m] w; L^-1 (w_s - bias_s); of the problem
};

}  // namespace palpate
