#pragma once

namespace palpate {

/// Isotropic material with Rayleigh damping D = alpha M + beta K.
struct Material {
  double youngs_modulus = 2e4;  ///< [Pa]
  double poisson_ratio = 0.4;   ///< in (-1, 0.5)
  double density = 1000.0;      ///< [kg/m^3]
  double damping_alpha = 0.0;   ///< [1/s]; drag against the world, left out of the coupling wrench
  double damping_beta = 0.002;  ///< [s]

  /// Of mass and stiffness in the matrix of an implicit step of h [s]: A = (1 + h alpha) M + (h beta + h^2) K.
  double massScale(double h) const { return 1.0 + h * damping_alpha; }
  double stiffnessScale(double h) const { return h * damping_beta + h * h; }
};

/// What may differ from tetrahedron to tetrahedron. Damping may not: D is proportional to M and K of the whole body.
struct ElementMaterial {
  double youngs_modulus = 2e4;  ///< [Pa]
  double poisson_ratio = 0.4;   ///< in (-1, 0.5)
  double density = 1000.0;      ///< [kg/m^3]
};

}  // namespace palpate
