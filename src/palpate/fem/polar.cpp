#include "palpate/fem/polar.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

Mat3 polarBySingularValues(const Mat3& f) {
  const Eigen::JacobiSVD<Mat3> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) *= -1.0;  // flips the smallest stretch
  return u * svd.matrixV().transpose();
}

// r times the rotation about w by 2 atan(|w| / 2), which is |w| but for its cube: no sine, no root.
Mat3 turned(const Mat3& r, const Vec3& w) {
  const Vec3 a = 0.5 * w;
  const double a2 = a.squaredNorm();
  Mat3 k = a * a.transpose() + skew(a);
  k.diagonal().array() -= a2;
  return r + (2.0 / (1.0 + a2)) * (r * k);
}

}  // namespace

Mat3 polarRotation(const Mat3& f, const Mat3& guess) {
  constexpr int kMaxIterations = 10;
  constexpr double kSmallRotation = 1e-5;  // the error after a Newton step is of the order of its cube
  Mat3 r = guess;
  for (int i = 0; i < kMaxIterations; ++i) {
    const Mat3 g = r.transpose() * f;
    const Vec3 axial(g(2, 1) - g(1, 2), g(0, 2) - g(2, 0), g(1, 0) - g(0, 1));
    // H = tr(G) 1 - sym(G), and the adjugate of it
    const double xx = g(1, 1) + g(2, 2), yy = g(0, 0) + g(2, 2), zz = g(0, 0) + g(1, 1);
    const double xy = -0.5 * (g(0, 1) + g(1, 0)), xz = -0.5 * (g(0, 2) + g(2, 0)), yz = -0.5 * (g(1, 2) + g(2, 1));
    const double cxx = yy * zz - yz * yz, cxy = xz * yz - xy * zz, cxz = xy * yz - xz * yy;
    const double cyy = xx * zz - xz * xz, cyz = xy * xz - xx * yz, czz = xx * yy - xy * xy;
    const double det = xx * cxx + xy * cxy + xz * cxz;
    // positive definite by leading minors, relative to the size of F
    const double scale = std::max({std::abs(xx), std::abs(yy), std::abs(zz), std::abs(xy), std::abs(xz), std::abs(yz)});
    if (!(xx > 0 && czz > 0 && det > 1e-6 * scale * scale * scale)) return polarBySingularValues(f);
    const Vec3 omega =
        Vec3(cxx * axial[0] + cxy * axial[1] + cxz * axial[2], cxy * axial[0] + cyy * axial[1] + cyz * axial[2],
             cxz * axial[0] + cyz * axial[1] + czz * axial[2]) /
        det;
    const double size2 = omega.squaredNorm();
    if (size2 > 1.0) return polarBySingularValues(f);
    if (size2 > 1e-30) r = turned(r, omega);
    if (size2 < kSmallRotation * kSmallRotation) return r;
  }
  return polarBySingularValues(f);
}

}  // namespace palpate
