#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "palpate/friction/contact_solver.h"

namespace palpate {

/// One contact with the others held: w = matrix lambda + free (bias already taken off the normal row).
struct SingleContact {
  Mat3 matrix;
  Vec3 free;
  double mu;
  Eigen::Matrix2d schur;     ///< tangential compliance with the normal velocity held at zero
  Eigen::Vector2d velocity;  ///< tangential velocity without friction impulse, normal velocity held at zero

  void eliminateNormal() {
    const double normal = matrix(0, 0);
    schur = matrix.bottomRightCorner<2, 2>() - matrix.bottomLeftCorner<2, 1>() * matrix.topRightCorner<1, 2>() / normal;
    velocity = free.tail<2>() - matrix.bottomLeftCorner<2, 1>() * (free[0] / normal);
    // keeps the tangential solve defined where a contact cannot move sideways
    schur.diagonal().array() += 1e-14 * matrix.trace();
  }
  double normalImpulse(const Eigen::Vector2d& tangential) const {
    return -(free[0] + matrix(0, 1) * tangential[0] + matrix(0, 2) * tangential[1]) / matrix(0, 0);
  }
  Vec3 impulse(const Eigen::Vector2d& tangential) const {
    return {normalImpulse(tangential), tangential[0], tangential[1]};
  }
};

/// x with (s + shift) x = rhs.
Eigen::Vector2d solve2(const Eigen::Matrix2d& s, double shift, const Eigen::Vector2d& rhs);

/// Impulse that slides on the exact cone; the normal has been eliminated.
Vec3 slideOnRoundCone(const SingleContact& local);

/// Sliding on the linearized cone: looks through vertices and edges, from the hinted one on, for the one that obeys the
/// law.
struct PolygonSlide {
  const SingleContact& local;
  const std::vector<Eigen::Vector2d>& corner;
  const std::vector<Eigen::Vector2d>& normal;
  const std::vector<Eigen::Vector2d>& tangent;
  int facets;
  double slack;  ///< [m/s] taken for rounding
  double best = std::numeric_limits<double>::infinity();
  Vec3 lambda = Vec3::Zero();
  ContactStatus status = {};

  void search(int hint);

 private:
  /// Keeps a candidate if it breaks the law less than those before; true if it obeys.
  bool offer(double violation, const Vec3& candidate, ContactStatus candidate_status);
  bool tryVertex(int k);
  bool tryEdge(int k);
};

}  // namespace palpate
