#pragma once

#include <array>
#include <vector>

#include "palpate/fem/material.h"
#include "palpate/linear/symmetric_block_matrix.h"
#include "palpate/math/types.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Centroids of the tetrahedra [m], which decide to what part of a body each belongs.
std::vector<Vec3> elementCentroids(const TetrahedralMesh& mesh);

/// Corotational linear tetrahedron (Mueller and Gross 2004, "Interactive virtual materials"). With c_i = R grad N_i and
/// the Lame constants times the material's volume, lambda and mu,
///   f_i  = -R (lambda tr(e) + 2 mu e) grad N_i,   e = sym(R^T F) - I
///   K_ij = lambda c_i c_j^T + mu c_j c_i^T + mu (c_i . c_j) I       (f(x + dx) = f - K dx at fixed R)
struct ElasticElement {
  std::array<int, 4> node;
  std::array<Vec3, 4> gradient;  ///< grad N_i in the rest shape [1/m]
  double lambda = 0;             ///< first Lame constant times the filled volume [N m]
  double mu = 0;                 ///< shear modulus times the filled volume [N m]
  Mat3 rotation = Mat3::Identity();

  Mat3 stiffness(const std::array<Vec3, 4>& c, int i, int j) const {
    Mat3 k = (lambda * c[i]) * c[j].transpose() + (mu * c[j]) * c[i].transpose();
    k.diagonal().array() += mu * c[i].dot(c[j]);
    return k;
  }
  std::array<Vec3, 4> rotatedGradients() const {
    return {rotation * gradient[0], rotation * gradient[1], rotation * gradient[2], rotation * gradient[3]};
  }
  Mat3 deformationGradient(const VecX& x) const {
    Mat3 f = x.segment<3>(3 * node[0]) * gradient[0].transpose();
    for (int k = 1; k < 4; ++k) f += x.segment<3>(3 * node[k]) * gradient[k].transpose();
    return f;
  }
};

/// Elastic body on tetrahedra: knows nodes, nothing of handles, contact or time steps. Positions and forces are flat
/// vectors of 3 coordinates a node [m], [N].
class ElasticMesh {
 public:
  /// @throws InputError for an element of non-positive or non-finite volume, or material out of range
  ElasticMesh(const SimulationMesh& mesh, const Material& material);
  /// The same with a material for each tetrahedron; of `material` only the damping counts then. Empty: uniform.
  /// @throws InputError also if there is neither none nor one for each tetrahedron
  ElasticMesh(const SimulationMesh& mesh, const Material& material, const std::vector<ElementMaterial>& per_element);

  int nodes() const { return static_cast<int>(mass_.size()); }
  /// Damping of the body; stiffness and density are those of elements without a material of their own.
  const Material& material() const { return material_; }
  const VecX& mass() const { return mass_; }  ///< lumped, a node [kg]
  const std::vector<ElasticElement>& elements() const { return elements_; }

  /// Element rotations of the given positions (polar decomposition, started from the present ones).
  void updateRotations(const VecX& x);
  /// Makes all elements stiffer by a factor > 0; damping follows.
  void scaleStiffness(double factor);
  /// Takes rotations saved earlier, one an element.
  void setRotations(const std::vector<Mat3>& rotations);
  /// Elastic forces at x with the present rotations; overwrites f [3 nodes].
  void forces(const VecX& x, VecX& f) const;
  /// Elastic energy at x with the present rotations [J]; its gradient is -forces once the rotations are those of x.
  double energy(const VecX& x) const;
  /// Elastic energy at x with the rotations of x [J]. Those in use stay; the new ones and their forces are kept for the
  /// case that the next updateRotations() and forces() are for the same x, as they are when x is the end of a step.
  double energyAt(const VecX& x);

  /// Prepares assemble(): the pattern of the nodes with row[node] >= 0, which must number 0..n-1.
  SymmetricBlockMatrix pattern(const std::vector<int>& row);
  /// a = mass_scale M + stiffness_scale K on the pattern's rows, with the present rotations.
  void assemble(double mass_scale, double stiffness_scale, SymmetricBlockMatrix& a) const;
  /// One of kParts shares of assemble(), which have no entry in common.
  void assemblePart(int part, double mass_scale, double stiffness_scale, SymmetricBlockMatrix& a) const;
  static constexpr int kParts = 4;

 private:
  struct PairSlot {
    int slot;           // -1: a node of the pair has no row
    std::uint8_t i, j;  // local nodes, in the order that the lower triangle needs
  };
  struct Part {  // of the matrix: slots [first, end), elements and nodes that have some there
    int first = 0, end = 0;
    std::vector<int> elements;
    std::vector<std::pair<int, int>> diagonal;  // node, slot
  };
  struct ElementForces {
    std::array<Vec3, 4> force;
    double energy;
  };
  static ElementForces forcesOf(const ElasticElement& e, const Mat3& rotation, const Mat3& gradient);
  static void add(const ElasticElement& e, const ElementForces& own, VecX& f);
  Material material_;
  std::vector<ElementForces> ahead_elements_;
  std::vector<Mat3> ahead_;  // rotations that energyAt() found
  VecX ahead_forces_;        // and forces with them
  VecX ahead_x_;             // for these positions; empty: none
  VecX forces_x_;            // the same once the rotations are in use
  VecX mass_;
  std::vector<ElasticElement> elements_;
  std::vector<std::array<PairSlot, 10>> slots_;  // an element
  std::array<Part, kParts> parts_;
};

}  // namespace palpate
