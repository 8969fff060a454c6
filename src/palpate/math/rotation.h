#pragma once

#include <cmath>

#include "palpate/math/types.h"

namespace palpate {

/// [a]x, so that skew(a) b = a x b.
inline Mat3 skew(const Vec3& a) {
  Mat3 s;
  s << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return s;
}

/// exp of a rotation vector [rad], as a unit quaternion. Series below 1e-4 rad, so that it is smooth at zero.
inline Quat expRotation(const Vec3& theta) {
  const double angle = theta.norm();
  const double half = 0.5 * angle;
  const double s = angle < 1e-4 ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  return Quat(std::cos(half), s * theta.x(), s * theta.y(), s * theta.z()).normalized();
}

/// Rotation vector [rad] of a unit quaternion, |result| <= pi. Policy near pi: the shorter way round; at exactly pi,
/// where both are as long, the axis is the quaternion's own vector part, so a path through pi jumps once and never
/// oscillates between evaluations of one state.
inline Vec3 logRotation(const Quat& q) {
  const Vec3 v = q.w() < 0 ? Vec3(-q.vec()) : Vec3(q.vec());
  const double w = std::abs(q.w());
  const double s = v.norm();
  // angle / sin(angle/2): 2 atan2(s, w) / s, by series where s vanishes
  const double scale = s < 1e-5 ? 2.0 / w * (1.0 - s * s / (3.0 * w * w)) : 2.0 * std::atan2(s, w) / s;
  return scale * v;
}

/// Left Jacobian of SO(3): exp(theta + d) = exp(J d) exp(theta) to first order in d. Rotation vector's rate to angular
/// velocity in the world: w = J d(theta)/dt.
inline Mat3 leftJacobian(const Vec3& theta) {
  const double angle2 = theta.squaredNorm();
  const double angle = std::sqrt(angle2);
  const bool small = angle < 1e-3;
  const double a = small ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  const double b = small ? 1.0 / 6.0 - angle2 / 120.0 : (angle - std::sin(angle)) / (angle2 * angle);
  const Mat3 s = skew(theta);
  return Mat3::Identity() + a * s + b * s * s;
}

/// c in the inverse left Jacobian I - [theta]x / 2 + c [theta]x^2, from |theta|^2.
inline double leftJacobianInverseCurvature(double angle2) {
  const double angle = std::sqrt(angle2);
  return angle < 1e-3 ? 1.0 / 12.0 + angle2 / 720.0
                      : 1.0 / angle2 - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle));
}

/// Inverse of the left Jacobian of SO(3) at theta: log(exp(d) exp(theta)) = theta + J^-1 d + O(d^2), for |theta| < 2
/// pi.
inline Mat3 leftJacobianInverse(const Vec3& theta) {
  const Mat3 s = skew(theta);
  return Mat3::Identity() - 0.5 * s + leftJacobianInverseCurvature(theta.squaredNorm()) * s * s;
}

/// Tangent (dp, dtheta) that leads from `from` to `to`: to = from advanced by the result.
inline Vec6 poseDifference(const Pose& to, const Pose& from) {
  Vec6 xi;
  xi.head<3>() = to.position - from.position;
  xi.tail<3>() = logRotation(to.rotation * from.rotation.conjugate());
  return xi;
}

/// Pose advanced by a tangent: p + dp, exp(dtheta) R.
inline Pose advance(const Pose& pose, const Vec6& xi) {
  return {pose.position + xi.head<3>(), (expRotation(xi.tail<3>()) * pose.rotation).normalized()};
}

/// Turns in place the vectors that a dense matrix holds one after the other (a multiple of 3 rows, column by column).
template <typename Columns>
void turnVectors(const Mat3& turn, Columns& columns) {
  for (double *x = columns.data(), *end = x + columns.size(); x != end; x += 3) {
    Eigen::Map<Vec3> vector(x);
    vector = (turn * vector).eval();
  }
}

}  // namespace palpate
