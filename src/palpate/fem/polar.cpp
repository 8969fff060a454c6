#include "palpate/fem/polar.h"

#include <Eigen/SVD>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

Mat3 polarBySingularValues(const Mat3& f) {
  const Eigen::JacobiSVD<Mat3> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) *= -1.0;  // flips the smallest stretch
  return u * svd.matrixV().transpose();
}

}  // namespace

Mat3 polarRotation(const Mat3& f, const Mat3& guess) {
  constexpr int kMaxIterations = 10;
  constexpr double kSmallRotation = 1e-8;  // the error after a Newton step is of the order of its cube
  Mat3 r = guess;
  for (int i = 0; i < kMaxIterations; ++i) {
    const Mat3 g = r.transpose() * f;
    const Vec3 axial(g(2, 1) - g(1, 2), g(0, 2) - g(2, 0), g(1, 0) - g(0, 1));
    const double trace = g.trace();
    Mat3 h = -0.5 * (g + g.transpose());
    h.diagonal().array() += trace;
    // positive definite by leading minors, relative to the size of F
    const double scale = h.cwiseAbs().maxCoeff();
    const double minor2 = h(0, 0) * h(1, 1) - h(0, 1) * h(1, 0);
    const double det = h.determinant();
    if (!(h(0, 0) > 0 && minor2 > 0 && det > 1e-6 * scale * scale * scale)) return polarBySingularValues(f);
    const Vec3 omega = h.inverse() * axial;
    const double size2 = omega.squaredNorm();
    if (size2 > 1.0) return polarBySingularValues(f);
    if (size2 > 1e-30) r = r * expRotation(omega).toRotationMatrix();
    if (size2 < kSmallRotation * kSmallRotation) return r;
  }
  return polarBySingularValues(f);
}

}  // namespace palpate
