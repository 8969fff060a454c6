#pragma once

#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// What a tetrahedron that is pressed flat in some direction, or turned over, resists beyond the linear law, which has
/// equilibria there that are turned over. With F = U diag(s) V^T (U, V in SO(3), so that the least stretch has the sign
/// of det F) its energy has for each principal direction
///   w(s) = k (s_0 - s)^2 / 2 where s < s_0, else 0,   k = 10 (lambda + 2 mu)
/// Of the curvature (Smith, de Goes, Kim 2019, "Analytic eigensystems for isotropic distortion energies") the positive
/// part counts, which leaves out what turns U against V:
///   K_ij = B_i B_j^T,   columns of B_i: sqrt(w''_k) u_k (c_i . u_k), and of each pair k, l
///   sqrt(t / 2) (u_k (c_i . u_l) + u_l (c_i . u_k)),   t = (w'_k - w'_l) / (s_k - s_l) >= 0
/// with c_i as in ElasticElement. Everything is for a stiffness scale of 1.
struct FlatElement {
  static constexpr double kStretch = 0.3;     ///< s_0: above it the law is linear
  static constexpr double kStiffness = 10.0;  ///< k by lambda + 2 mu

  int element = 0;  ///< index in the mesh
  Mat3 frame;       ///< columns u_k, in the frame of the positions
  Vec3 stress;      ///< w'_k [N m]
  Vec3 stretch;     ///< w''_k [N m]
  Vec3 shear;       ///< t / 2 of the pairs (1, 2), (2, 0), (0, 1) [N m]
  double energy;    ///< sum of w [J]

  /// Of an element that isThick() says no of.
  /// @param turned  R^T F
  /// @param modulus  lambda + 2 mu, times the filled volume [N m]
  FlatElement(int element, const Mat3& rotation, const Mat3& turned, double modulus);

  using Factor = Eigen::Matrix<double, 3, 6>;
  /// B_i of c_i = R grad N_i [1/m].
  Factor factor(const Vec3& c) const;
  /// Its part of the stress, P R^T times the volume [N m], linear in the deformation gradient with u_k and v_k held.
  /// @param gradient  F R^T, or with 0 in place of 1 a change of it
  Mat3 linearStress(const Mat3& gradient, double one) const;
};

/// Whether all principal stretches exceed FlatElement::kStretch.
/// @param turned  R^T F
bool isThick(const Mat3& turned);

/// The one of that index in a list ordered by index; null: it is not flat.
const FlatElement* flatElement(const std::vector<FlatElement>& flat, int element);

}  // namespace palpate
