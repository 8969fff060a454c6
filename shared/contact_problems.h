#pragma once

// Contact problems for the friction solver: of a soft bar dragged over a floor, and random ones of any rank.

#include <Eigen/Cholesky>
#include <cmath>
#include <random>
#include <vector>

#include "palpate/friction/contact_solver.h"

namespace palpate::test {

/// A contact problem with its own storage.
struct OwnedProblem {
  MatX delassus;
  VecX free, bias, friction;
  FrictionCone cone;

  int contacts() const { return static_cast<int>(bias.size()); }
  ContactProblem view() const { return {delassus, free, bias, friction, cone}; }
};

/// A soft bar of nx x ny x nz nodes joined by springs to all 26 neighbors, implicit, pressed on a floor and dragged:
/// the kind of W that condensed finite elements give. `points` contact points are spread over its bottom face, each a
/// convex combination of the nodes of one triangle of the face, so that with more points than nodes W loses rank.
struct SoftBar {
  int nx = 5, ny = 5, nz = 4;
  double node_mass = 1e-3;  ///< [kg]
  double stiffness = 60.0;  ///< of one spring [N/m]
  double step = 0.02;       ///< [s]
  double bumpiness = 2e-4;  ///< standard deviation of the floor's height [m]
  double press = 0.05;      ///< [m/s]
  double drag = 0.1;        ///< [m/s]
  double mu = 0.5;

  /// @param on_nodes  one contact on each bottom node (points is then ignored)
  OwnedProblem make(int points, bool on_nodes, unsigned seed, const FrictionCone& cone = {}) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    const auto node = [&](int x, int y, int z) { return (z * ny + y) * nx + x; };
    const int n = nx * ny * nz;
    MatX a = MatX::Zero(3 * n, 3 * n);
    a.diagonal().setConstant(node_mass);
    const double factor = step * step * stiffness + 0.005 * step * stiffness;
    for (int z = 0; z < nz; ++z)
      for (int y = 0; y < ny; ++y)
        for (int x = 0; x < nx; ++x)
          for (int k = 0; k < 27; ++k) {
            const Vec3 d(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
            const int u = x + k % 3 - 1, v = y + k / 3 % 3 - 1, w = z + k / 9 - 1;
            if (k <= 13 || u < 0 || v < 0 || w < 0 || u >= nx || v >= ny || w >= nz) continue;
            const int i = 3 * node(x, y, z), j = 3 * node(u, v, w);
            const Mat3 block = factor * (d * d.transpose() / d.squaredNorm() + 0.05 * Mat3::Identity());
            a.block<3, 3>(i, i) += block;
            a.block<3, 3>(j, j) += block;
            a.block<3, 3>(i, j) -= block;
            a.block<3, 3>(j, i) -= block;
          }
    VecX velocity(3 * n);
    for (int i = 0; i < n; ++i)
      velocity.segment<3>(3 * i) =
          Vec3(drag, 0.3 * drag, -press) + 0.02 * Vec3(normal(random), normal(random), normal(random));
    // the top layer is held, so that there is something to press with
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x) a.diagonal().segment<3>(3 * node(x, y, nz - 1)).array() += 1.0;

    const int m = on_nodes ? nx * ny : points;
    MatX jacobian = MatX::Zero(3 * m, 3 * n);
    OwnedProblem problem;
    problem.cone = cone;
    problem.bias.resize(m);
    problem.friction.setConstant(m, mu);
    for (int i = 0; i < m; ++i) {
      int corner[3] = {i, i, i};
      double weight[3] = {1.0, 0.0, 0.0};
      if (!on_nodes) {
        const int x = static_cast<int>(uniform(random) * (nx - 1)), y = static_cast<int>(uniform(random) * (ny - 1));
        corner[0] = node(x, y, 0);
        corner[1] = node(x + 1, y, 0);
        corner[2] = node(x + 1, y + 1, 0);
        weight[0] = uniform(random);
        weight[1] = uniform(random) * (1.0 - weight[0]);
        weight[2] = 1.0 - weight[0] - weight[1];
      }
      for (int c = 0; c < 3; ++c) {
        jacobian(3 * i, 3 * corner[c] + 2) += weight[c];
        jacobian(3 * i + 1, 3 * corner[c]) += weight[c];
        jacobian(3 * i + 2, 3 * corner[c] + 1) += weight[c];
      }
      problem.bias[i] = bumpiness / step * normal(random) - 0.01;
    }
    const Eigen::LLT<MatX> factorized(a);
    const MatX half = factorized.matrixL().solve(jacobian.transpose());
    problem.delassus = half.transpose() * half;
    problem.free = jacobian * velocity;
    return problem;
  }
};

/// W = G G^T with G of 3m x rank, contacts scaled between 1 and `mass_ratio`.
inline OwnedProblem randomProblem(int m, int rank, double mass_ratio, unsigned seed, const FrictionCone& cone) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  OwnedProblem problem;
  problem.cone = cone;
  MatX g(3 * m, rank);
  for (Eigen::Index k = 0; k < g.size(); ++k) g.data()[k] = normal(random);
  for (int i = 0; i < m; ++i) g.middleRows<3>(3 * i) *= std::sqrt(std::pow(mass_ratio, uniform(random)) / rank);
  problem.delassus = g * g.transpose();
  problem.friction.resize(m);
  problem.bias.resize(m);
  for (int i = 0; i < m; ++i) {
    problem.friction[i] = 1.2 * uniform(random);
    problem.bias[i] = -0.1 * uniform(random);
  }
  // a velocity that some motion of the rank's freedoms has, so that a solution exists: contacts separate under G x
  VecX motion(rank);
  for (int k = 0; k < rank; ++k) motion[k] = normal(random);
  problem.free = g * motion;
  return problem;
}

}  // namespace palpate::test
