#pragma once

#include <limits>
#include <vector>

#include "palpate/friction/contact_interior.h"
#include "palpate/friction/contact_problem.h"
#include "palpate/friction/reduced_contacts.h"
#include "palpate/friction/state_factor.h"
#include "palpate/linear/aligned_buffer.h"
#include "palpate/math/types.h"

namespace palpate {

struct ContactSolverSettings {
  int max_iterations = 1000;
  /// Bound on the work of a solve, counted in factorizations: 18 m^3 + 2000 m^2 + 2e5 m operations each, m contacts.
  /// Counted, not clocked, so the result stays deterministic. What a hard problem may take; most need far less.
  double max_work = 100.0;
  double max_operations =
      std::numeric_limits<double>::infinity();  ///< the same without regard to m; about 1e10 a second
  double tolerance = 1e-10;                     ///< on the residual, relative to the largest velocity in the problem
  /// A residual that will do where the tolerance is not reached by sweeps and Newton steps: the dearer methods are then
  /// left alone, and the solve counts as converged. 0: none but the tolerance.
  double acceptable = 0.0;
};

struct ContactSolverReport {
  bool converged = false;     ///< to what will do
  bool to_tolerance = false;  ///< to the tolerance
  int iterations = 0;
  double operations = 0;  ///< work, as ContactSolverSettings::max_operations counts it
  double residual = 0.0;  ///< largest violation of the contact law, as a velocity [m/s]

  /// Where there was nothing to solve.
  static constexpr ContactSolverReport nothing() { return {true, true, 0, 0.0, 0.0}; }
};

/// Solves ContactProblem: Gauss-Seidel sweeps with exact solutions of single contacts find the states, Newton steps on
/// the rows that the states leave free solve them to the last digits; where that fails, interior-point iterations and
/// proximal ones find the states. With a warm start, for the contacts whose states are in doubt first
/// (docs/contact-solver.md). Keep one for each scene: it owns the workspace, which grows on demand and is reused.
/// Deterministic: the result depends on the arguments only.
class ContactSolver {
 public:
  /// @param lambda  impulses [N s], 3m: in, the warm start (set to zero if it has another size or is not finite); out,
  /// the
  ///                solution, or the best found. Never pulls, and never leaves the cone by more than rounding.
  /// @param status  in, states to try first with the warm start (ignored if the size differs); out, the states that
  /// lambda
  ///                was computed from: open means lambda_i = 0 and nothing else does, stick strictly inside the
  ///                cone, edge and vertex exactly there. Without friction (mu = 0) a closed contact is `slide`,
  ///                lambda_t = 0, for both cones.
  /// @return residual as in contactResidual; converged if it is at most tolerance times the largest entry of free and
  /// bias.
  ///         Input that is not finite: not converged, residual infinite, lambda zero. Work is bounded by max_iterations
  ///         (sweeps plus Newton steps), also where no solution exists.
  /// Throws std::invalid_argument for sizes that do not match, negative friction, fewer than three facets.
  ContactSolverReport solve(const ContactProblem& problem, const ContactSolverSettings& settings, VecX& lambda,
                            std::vector<ContactStatus>& status);

 private:
  struct Best {
    VecX lambda;
    std::vector<ContactStatus> status;
    double residual = 0.0;  ///< [m/s]
  };
  struct Work {
    int max_iterations = 0;
    double max_operations = 0.0;
    double product = 0.0;  ///< what a product with W counts as
    int iterations = 0;
    double operations = 0.0;
    bool left() const { return iterations < max_iterations && operations < max_operations; }
    double remaining() const { return max_operations - operations; }
    /// @param contacts  of the problem
    void begin(double contacts, int iterations_at_most, double operations_at_most) {
      *this = {iterations_at_most, operations_at_most, 90.0 * contacts * contacts};
    }
    void spend(double cost) {
      ++iterations;
      operations += cost;
    }
  };

  void prepare(const ContactProblem& problem, double mean_scale);
  bool acceptHint(const ContactProblem& problem, const std::vector<ContactStatus>& hint);
  ContactStatus nearest(const FrictionCone& cone, double radius, const Eigen::Vector2d& p,
                        Eigen::Vector2d& point) const;
  void updateVelocity(const ContactProblem& problem, const VecX& lambda, VecX& w);
  void updateVelocitySince(const ContactProblem& problem, const VecX& before);
  double residual(const ContactProblem& problem) const;
  double keepBest(const ContactProblem& problem, Best& best);
  void goTo(const ContactProblem& problem, const Best& best);
  Vec3 augmented(const ContactProblem& problem, Eigen::Index i) const;
  void classify(const ContactProblem& problem);
  void walk(const FrictionCone& cone, const std::vector<ContactStatus>& before);
  void settleStates(const ContactProblem& problem);
  void sweep(const ContactProblem& problem);
  void newtonPhase(const ContactProblem& problem, double tolerance, Best& best, int steps, Work& work,
                   int patience = 4);
  bool alternate(const ContactProblem& problem, double tolerance, Best& best, int rounds, Work& work);
  void proximal(const ContactProblem& problem, double tolerance, Best& best, Work& work);
  void interior(const ContactProblem& problem, double tolerance, double acceptable, Best& best, Work& work);
  void makePassive(const ContactProblem& problem, double slack);
  void findParts(const ContactProblem& problem);
  ContactSolverReport solvePart(const ContactProblem& problem, const ContactSolverSettings& settings, double scale,
                                double mean_scale, VecX& lambda, std::vector<ContactStatus>& status);
  ContactSolverReport gatherAndSolve(const ContactProblem& whole, const int* contacts, int count,
                                     const ContactSolverSettings& settings, double scale, double mean_scale,
                                     VecX& lambda, std::vector<ContactStatus>& status);
  bool begin(const ContactProblem& problem, double mean_scale, const VecX& lambda,
             const std::vector<ContactStatus>& status);
  void find(const ContactProblem& problem, double enough, double tolerance, double acceptable, bool hinted, Work& work);
  bool inDoubt(const ContactProblem& problem, Eigen::Index i, double tolerance) const;
  bool findDoubtful(const ContactProblem& problem, double tolerance);
  bool opensAgainst(const ContactProblem& problem) const;
  void doubtPhase(const ContactProblem& problem, double tolerance, double acceptable, Work& work);
  bool newton(const ContactProblem& problem, double tolerance, Work& work);
  void chooseFree(const ContactProblem& problem);
  void setCurvature(const ContactProblem& problem);
  double freeResidual(const ContactProblem& problem);
  void stepFree(const ContactProblem& problem);
  bool solveStates(const ContactProblem& problem, double tolerance);

  VecX rho_;                              ///< [m] impulse times this compares with velocity [1/kg]
  VecX lambda_, w_;                       ///< [3m] the iterate and its velocity
  std::vector<ContactStatus> status_;     ///< [m]
  std::vector<ContactStatus> before_;     ///< [m] those of the last Newton step
  std::vector<Eigen::Vector2d> heading_;  ///< [m] unit direction of friction, exact cone
  Best best_, swept_, nearby_, center_;   ///< of the problem; where sweeps ended; of a proximal problem
  VecX shifted_free_;
  InteriorPoint interior_;
  std::vector<Eigen::Vector2d> corner_, normal_, tangent_;  ///< [facets] of the unit polygon
  std::vector<FreeDirections> free_;                        ///< closed contacts, sticking ones first
  StateFactor factor_;
  const double* factored_ = nullptr;  ///< the W that factor_ is of
  bool may_border_ = true;            ///< until a bordered factor was not good enough for this problem
  VecX violation_, change_;           ///< [3m] what should vanish where states leave impulses free; a Newton step
  VecX unmoved_;                      ///< [3m] impulses before it
  std::vector<char> doubted_;         ///< [m] contacts whose states are in doubt
  ReducedContacts reduced_;           ///< what they leave to be solved
  std::vector<ContactSolver> doubtful_solver_;  ///< one, for that
  VecX own_lambda_;                             ///< where it starts
  std::vector<ContactStatus> own_status_;
  AlignedBuffer shifted_matrix_;
  AlignedBuffer part_velocity_;  ///< what each part of W adds to a velocity

  std::vector<int> order_, part_start_, waiting_;  ///< contacts by part, where each part begins
  std::vector<ContactSolver> parts_;               ///< one for each, so that sizes stay and nothing is allocated
  AlignedBuffer part_matrix_;                      ///< a part's own problem and start
  VecX part_free_, part_bias_, part_friction_, part_lambda_;
  std::vector<ContactStatus> part_status_;
};

}  // namespace palpate
