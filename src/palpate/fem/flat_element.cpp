#include "palpate/fem/flat_element.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace palpate {

bool isThick(const Mat3& turned) {
  // sym(R^T F) - s_0 is positive definite, by leading minors
  const double s = FlatElement::kStretch;
  const double xx = turned(0, 0) - s, yy = turned(1, 1) - s, zz = turned(2, 2) - s;
  const double xy = 0.5 * (turned(0, 1) + turned(1, 0)), xz = 0.5 * (turned(0, 2) + turned(2, 0)),
               yz = 0.5 * (turned(1, 2) + turned(2, 1));
  return xx > 0 && xx * yy - xy * xy > 0 &&
         xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz) > 0;
}

FlatElement::FlatElement(int index, const Mat3& rotation, const Mat3& turned, double modulus)
    : element(index), energy(0) {
  const Eigen::SelfAdjointEigenSolver<Mat3> spectrum(0.5 * (turned + turned.transpose()));
  const Vec3& s = spectrum.eigenvalues();
  frame = rotation * spectrum.eigenvectors();
  const double k = kStiffness * modulus;
  for (int i = 0; i < 3; ++i) {
    const double lack = std::max(kStretch - s[i], 0.0);
    energy += 0.5 * k * lack * lack;
    stress[i] = -k * lack;
    stretch[i] = lack > 0 ? k : 0.0;
  }
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, l = (i + 2) % 3;
    if (stretch[j] == stretch[l]) {  // both are short, or none
      shear[i] = 0.5 * stretch[j];
    } else {
      shear[i] = 0.5 * (stress[j] - stress[l]) / (s[j] - s[l]);
    }
  }
}

FlatElement::Factor FlatElement::factor(const Vec3& c) const {
  Factor out;
  const Vec3 along = frame.transpose() * c;
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    out.col(k) = (std::sqrt(stretch[k]) * along[k]) * frame.col(k);
    out.col(3 + k) = std::sqrt(shear[k]) * (along[j] * frame.col(i) + along[i] * frame.col(j));
  }
  return out;
}

Mat3 FlatElement::linearStress(const Mat3& gradient, double one) const {
  const Mat3 d = frame.transpose() * gradient * frame;
  Mat3 p;
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    p(k, k) = stretch[k] * (d(k, k) - one * kStretch);
    p(i, j) = p(j, i) = shear[k] * (d(i, j) + d(j, i));
  }
  return frame * p * frame.transpose();
}

const FlatElement* flatElement(const std::vector<FlatElement>& flat, int element) {
  const auto at = std::lower_bound(flat.begin(), flat.end(), element,
                                   [](const FlatElement& f, int index) { return f.element < index; });
  return at != flat.end() && at->element == element ? &*at : nullptr;
}

}  // namespace palpate
