#include "palpate/fem/polar.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

Mat3 polarBySingularValues(const Mat3& f) {
  const Eigen::JacobiSVD<Mat3> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) *= -1.0;  // flips the smallest stretch
  return u * svd.matrixV().transpose();
}

constexpr int kMaxIterations = 10;
constexpr double kSmallRotation = 1e-5;  // the error after a Newton step is of the order of its cube
constexpr double kIndefinite = 1e-6;     // determinant, of the cube of the largest coefficient
constexpr double kUnchanged = 1e-30;     // square of an angle by which nothing is turned

}  // namespace

Mat3 polarRotation(const Mat3& f, const Mat3& guess) {
  Mat3 rotation = guess;
  polarRotations({f}, {&rotation}, 1);
  return rotation;
}

// Newton: the axial vector of G = R^T F over H = tr(G) 1 - sym(G), by its adjugate, is the rotation vector that is
// left. R is turned about it by 2 atan of half its length, which is that but for its cube: no sine, no root. What has
// arrived stays as it is while others go on, so that none depends on the others.
void polarRotations(const std::array<Mat3, 4>& f, const std::array<Mat3*, 4>& rotation, int count) {
  using Lanes = double __attribute__((vector_size(32)));
  using Matrix = std::array<std::array<Lanes, 3>, 3>;
  Matrix r, d;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int n = 0; n < 4; ++n) {
        r[i][j][n] = n < count ? (*rotation[n])(i, j) : i == j;
        d[i][j][n] = n < count ? f[n](i, j) : i == j;
      }
    }
  }
  auto busy = r[0][0] == r[0][0];  // in all four
  busy |= ~busy;
  auto poor = ~busy;
  const auto any = [](const auto& mask) { return (mask[0] | mask[1] | mask[2] | mask[3]) != 0; };
  for (int iteration = 0; iteration < kMaxIterations && any(busy); ++iteration) {
    Matrix g;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) g[i][j] = r[0][i] * d[0][j] + r[1][i] * d[1][j] + r[2][i] * d[2][j];
    }
    const std::array<Lanes, 3> axial{g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]};
    const Lanes xx = g[1][1] + g[2][2], yy = g[0][0] + g[2][2], zz = g[0][0] + g[1][1];
    const Lanes xy = -0.5 * (g[0][1] + g[1][0]), xz = -0.5 * (g[0][2] + g[2][0]), yz = -0.5 * (g[1][2] + g[2][1]);
    const Lanes cxx = yy * zz - yz * yz, cxy = xz * yz - xy * zz, cxz = xy * yz - xz * yy;
    const Lanes cyy = xx * zz - xz * xz, cyz = xy * xz - xx * yz, czz = xx * yy - xy * xy;
    const Lanes det = xx * cxx + xy * cxy + xz * cxz;
    Lanes scale = xx;
    for (const Lanes& c : {-xx, yy, -yy, zz, -zz, xy, -xy, xz, -xz, yz, -yz}) scale = scale < c ? c : scale;
    const std::array<Lanes, 3> a{0.5 * ((cxx * axial[0] + cxy * axial[1] + cxz * axial[2]) / det),
                                 0.5 * ((cxy * axial[0] + cyy * axial[1] + cyz * axial[2]) / det),
                                 0.5 * ((cxz * axial[0] + cyz * axial[1] + czz * axial[2]) / det)};
    const Lanes a2 = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    const Lanes size2 = 4.0 * a2;
    // H is positive definite by leading minors, relative to the size of F
    const auto good = (xx > 0.0) & (czz > 0.0) & (det > kIndefinite * scale * scale * scale) & (size2 <= 1.0);
    poor |= busy & ~good;
    busy &= good;
    const Matrix k{{{a[0] * a[0] - a2, a[0] * a[1] - a[2], a[0] * a[2] + a[1]},
                    {a[1] * a[0] + a[2], a[1] * a[1] - a2, a[1] * a[2] - a[0]},
                    {a[2] * a[0] - a[1], a[2] * a[1] + a[0], a[2] * a[2] - a2}}};
    const Lanes factor = 2.0 / (1.0 + a2);
    const auto turns = busy & (size2 > kUnchanged);
    for (int i = 0; i < 3; ++i) {
      const std::array<Lanes, 3> row = r[i], scaled{factor * row[0], factor * row[1], factor * row[2]};
      for (int j = 0; j < 3; ++j) {
        const Lanes turned = row[j] + (scaled[0] * k[0][j] + scaled[1] * k[1][j] + scaled[2] * k[2][j]);
        r[i][j] = turns ? turned : row[j];
      }
    }
    busy &= ~(size2 < kSmallRotation * kSmallRotation);
  }
  poor |= busy;
  for (int n = 0; n < count; ++n) {
    if (poor[n] != 0) {
      *rotation[n] = polarBySingularValues(f[n]);
      continue;
    }
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) (*rotation[n])(i, j) = r[i][j][n];
    }
  }
}

}  // namespace palpate
