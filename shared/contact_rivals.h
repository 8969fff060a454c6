#pragma once

// The solvers that the friction solver is measured against.

#include "palpate/friction/contact_solver.h"

/// Other ways to solve a ContactProblem, to compare with. All stop when contactResidual is at most `tolerance` times
/// the largest velocity, looked at every few iterations, or at their limit. They start from zero.
namespace palpate::rivals {

struct Outcome {
  VecX lambda;
  int iterations = 0;
  double residual = 0.0;  ///< contactResidual, relative to the largest velocity
};

/// Nearest impulse of the friction cone's section: |lambda_t| in mu lambda_n K, lambda_n >= 0 kept.
Eigen::Vector2d nearestInSection(const FrictionCone& cone, double radius, const Eigen::Vector2d& p);

/// Projected Gauss-Seidel on W: one step of each contact along -w, normal first, then back onto the section.
Outcome projectedGaussSeidel(const ContactProblem& problem, double tolerance, int limit);

/// Accelerated projected gradient descent (Mazhar, Heyn, Negrut, Tasora 2015) for the cone problem that neglects the
/// dilation, which an outer fixed point puts right (de Saxce's normal velocity mu |w_t|). Exact cone only.
Outcome acceleratedProjectedGradient(const ContactProblem& problem, double tolerance, int limit);

/// Nonsmooth Newton of Alart and Curnier on W alone: full steps on the natural map, one dense LU each.
Outcome nonsmoothNewton(const ContactProblem& problem, double tolerance, int limit);

/// Iterative constraint anticipation in the manner of Otaduy, Tamstorf, Steinemann and Gross (2009): block Jacobi on A
/// outside (blocks of a node, damped by `damping` on the diagonal), projected Gauss-Seidel on J D^-1 J^T inside. Never
/// forms W; the problem is only used to measure.
/// @param system A, @param jacobian J, @param momentum A times the free velocity
Outcome constraintAnticipation(const ContactProblem& problem, const MatX& system, const MatX& jacobian,
                               const VecX& momentum, double tolerance, int limit);

}  // namespace palpate::rivals
