#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace palpate {

using Vec3 = Eigen::Vector3d;
using Vec4 = Eigen::Vector4d;
using Mat3 = Eigen::Matrix3d;
using VecX = Eigen::VectorXd;
using MatX = Eigen::MatrixXd;
using Quat = Eigen::Quaterniond;

/// Twist (v, w) [m/s, rad/s], wrench (f, tau) [N, N m] or tangent of a pose (dp, dtheta) [m, rad]; world frame, the
/// linear part first. Unaligned, so that it may live in any container.
using Vec6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;
/// Maps a Vec6 to a Vec6; columns and rows in the same order.
using Mat6 = Eigen::Matrix<double, 6, 6, Eigen::DontAlign>;

/// Position [m] and orientation of a rigid frame in the world. Tangent: p <- p + dp, R <- exp(dtheta) R.
struct Pose {
  Vec3 position = Vec3::Zero();
  Quat rotation = Quat::Identity();

  Mat3 matrix() const { return rotation.toRotationMatrix(); }
  /// World coordinates of a point given in the frame.
  Vec3 apply(const Vec3& local) const { return position + rotation * local; }
  bool allFinite() const { return position.allFinite() && rotation.coeffs().allFinite(); }
};

}  // namespace palpate
