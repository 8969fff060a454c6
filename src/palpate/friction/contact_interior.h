#pragma once

#include <vector>

#include "palpate/math/types.h"

namespace palpate {

struct ContactProblem;

/// Interior-point iterations (Mehrotra's predictor and corrector) for ContactProblem. Coulomb's law is written with
/// smooth products that all should vanish, so that there is nothing to choose from on the way:
///   w_n - bias = y,   lambda_n y = 0                                  lambda_n, y >= 0
///   w_t = z_t,        (mu lambda_n, lambda_t) o (z_0, z_t) = 0        both in the round cone; z_0 ends as |w_t|
/// or, on the polygon with apothem a = mu cos(pi / facets) and outward edge normals m_k,
///   w_t = -sum z_k m_k,   (a lambda_n - m_k . lambda_t) z_k = 0       for each edge, both >= 0
/// The products are followed down to zero together, which leads to the middle of the set of solutions: redundant
/// contacts share the load. The law is not that of an optimization problem, so nothing warrants that a step is long;
/// when steps get short, more of rho is added to the diagonal of the matrix until they are not.
class InteriorPoint {
 public:
  /// Starts in the middle of the cones.
  /// @param rho    [m] impulse times this compares with velocity [1/kg]
  /// @param speed  what velocities are like [m/s]
  void start(const ContactProblem& problem, const VecX& rho, double speed);
  /// Impulses, strictly inside their cones (lambda_t = 0 without friction) [N s].
  const VecX& impulse() const { return impulse_; }
  /// One iteration: a factorization, two solutions. False if nothing is gained any more.
  bool iterate(const ContactProblem& problem, const VecX& rho);
  /// What an iteration counts as, in operations.
  static double cost(double contacts);

 private:
  bool factorize(const ContactProblem& problem, const VecX& rho);
  double findStep(const ContactProblem& problem, double aim);
  double products(double length) const;

  Eigen::Index stride_ = 0;                                    ///< rows of a contact's cone
  double count_ = 0.0;                                         ///< of the products that should vanish
  double length_ = 1.0;                                        ///< of the last step, 1: all of it
  double damping_ = 0.0;                                       ///< what is added to the diagonal, in units of rho
  VecX impulse_, surplus_, slack_, dual_;                      ///< lambda [3m], y [m], cone and dual [stride m]
  VecX impulse_step_, surplus_step_, slack_step_, dual_step_;  ///< their steps
  VecX defect_, surplus_target_, dual_target_;                 ///< of the velocities [3m]; steps with lambda held
  VecX normal_products_;                                       ///< [m] the corrector's
  std::vector<double, Eigen::aligned_allocator<double>> matrix_;
  std::vector<int> pivots_;
  std::vector<Eigen::Vector2d> normals_;  ///< [facets] outward, of the polygon's edges
};

}  // namespace palpate
