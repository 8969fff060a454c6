#include "palpate/friction/single_contact.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate {

using Vec2 = Eigen::Vector2d;
using Mat2 = Eigen::Matrix2d;

Vec2 solve2(const Mat2& s, double shift, const Vec2& rhs) {
  const double a = s(0, 0) + shift, b = s(0, 1), c = s(1, 0), d = s(1, 1) + shift;
  const double determinant = a * d - b * c;
  return {(d * rhs[0] - b * rhs[1]) / determinant, (a * rhs[1] - c * rhs[0]) / determinant};
}

/// Sliding on the exact cone: lambda_t = -w_t / alpha, so lambda_t(alpha) = -(S + alpha)^-1 c. Its length falls with
/// alpha, and what is sought is the alpha at which it meets mu lambda_n. Sticking exceeds the cone (alpha = 0) and no
/// friction impulse (alpha = infinity) is within it, so a root is bracketed; Illinois steps in s = alpha / (alpha +
/// trace).
Vec3 slideOnRoundCone(const SingleContact& local) {
  const double unit = std::max(local.schur.trace(), 1e-12 * local.matrix.trace());
  const auto excess = [&](double s, Vec2& tangential) {
    if (s >= 1.0) {
      tangential.setZero();
      return -local.mu * local.normalImpulse(tangential);
    }
    tangential = solve2(local.schur, unit * s / (1.0 - s), -local.velocity);
    return tangential.norm() - local.mu * local.normalImpulse(tangential);
  };
  Vec2 tangential;
  double low = 0.0, high = 1.0;
  double at_low = excess(low, tangential), at_high = excess(high, tangential);
  const double accuracy = 1e-15 * std::abs(at_high);
  int side = 0;
  for (int i = 0; i < 60; ++i) {
    double s = (low * at_high - high * at_low) / (at_high - at_low);
    if (i > 30 || !(s > low && s < high)) s = 0.5 * (low + high);
    if (s == low || s == high) break;
    const double value = excess(s, tangential);
    if (std::abs(value) <= accuracy) break;
    if (value > 0.0) {
      low = s;
      at_low = value;
      if (side == 1) at_high *= 0.5;
      side = 1;
    } else {
      high = s;
      at_high = value;
      if (side == -1) at_low *= 0.5;
      side = -1;
    }
  }
  Vec3 lambda = local.impulse(tangential);
  lambda[0] = std::max(lambda[0], 0.0);
  const double length = tangential.norm();
  if (length > 0.0) lambda.tail<2>() *= local.mu * lambda[0] / length;
  return lambda;
}

bool PolygonSlide::offer(double violation, const Vec3& candidate, ContactStatus candidate_status) {
  if (violation >= best) return false;
  best = violation;
  lambda = candidate;
  status = candidate_status;
  return best <= slack;
}

bool PolygonSlide::tryVertex(int k) {
  const Vec2& d = corner[k];
  const double row = local.matrix(0, 0) + local.mu * (local.matrix(0, 1) * d[0] + local.matrix(0, 2) * d[1]);
  if (row <= 1e-12 * local.matrix(0, 0)) return false;
  const double n = -local.free[0] / row;
  const Vec3 candidate(n, local.mu * n * d[0], local.mu * n * d[1]);
  const Vec2 w = local.free.tail<2>() + local.matrix.bottomRows<2>() * candidate;
  const int before = k == 0 ? facets - 1 : k - 1, after = k + 1 == facets ? 0 : k + 1;
  return offer(std::max(w.dot(d - corner[before]), w.dot(d - corner[after])), candidate, {ContactState::vertex, k});
}

bool PolygonSlide::tryEdge(int k) {
  // lambda = n (1, mu cos(pi/k) m) + t (0, e), with w_n = 0 and e . w_t = 0
  const double reach = local.mu * std::cos(std::numbers::pi / facets);
  const double half = local.mu * std::sin(std::numbers::pi / facets);
  const Vec3 along(1.0, reach * normal[k][0], reach * normal[k][1]);
  const Vec3 across(0.0, tangent[k][0], tangent[k][1]);
  const Vec3 rows_along = local.matrix * along, rows_across = local.matrix * across;
  const double a = rows_along[0], b = rows_across[0], c = across.dot(rows_along), d = across.dot(rows_across);
  const double determinant = a * d - b * c;
  if (std::abs(determinant) <= 1e-14 * local.matrix(0, 0) * local.matrix.trace()) return false;
  const double f = across.dot(local.free);
  const double n = (-d * local.free[0] + b * f) / determinant;
  const double t = (c * local.free[0] - a * f) / determinant;
  if (n < 0.0) return false;
  const Vec3 candidate = n * along + t * across;
  const Vec2 w = local.free.tail<2>() + local.matrix.bottomRows<2>() * candidate;
  const double beyond = (std::abs(t) - half * n) * d;
  return offer(std::max(w.dot(normal[k]), beyond), candidate, {ContactState::edge, k});
}

void PolygonSlide::search(int hint) {
  for (int j = 0; j < facets; ++j) {
    const int k = (hint + j) % facets;
    if (tryVertex(k) || tryEdge(k)) return;
  }
}

}  // namespace palpate
