#pragma once

#include <array>
#include <vector>

#include "palpate/fem/edge_winding.h"
#include "palpate/fem/flat_element.h"
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
/// What fixed rotations leave out is the energy's curvature in the three directions that turn F = R S against R, with S
/// = V diag(s) V^T and principal stresses p_k = 2 mu (s_k - 1) + lambda (tr S - 3):
///   Q_k = R [v_k]x / sqrt(2),   t_k = (p_i + p_j) / (s_i + s_j)
/// (Smith, de Goes, Kim 2019, "Analytic eigensystems for isotropic distortion energies"). Positive under tension, where
/// it is what keeps a rope straight; cut off at zero it makes the whole stiffness, positive semidefinite:
///   K_ij += B_i B_j^T,   B_i = [c_i]x P,   P = R V diag(sqrt(t_k / 2))
/// One that is pressed flat resists more: FlatElement.
struct ElasticElement {
  std::array<int, 4> node;
  std::array<Vec3, 4> gradient;  ///< grad N_i in the rest shape [1/m]
  double lambda = 0;             ///< first Lame constant times the filled volume [N m]
  double mu = 0;                 ///< shear modulus times the filled volume [N m]

  Mat3 stiffness(const std::array<Vec3, 4>& c, int i, int j) const {
    Mat3 k = (lambda * c[i]) * c[j].transpose() + (mu * c[j]) * c[i].transpose();
    k.diagonal().array() += mu * c[i].dot(c[j]);
    return k;
  }
  /// c_i = R grad N_i.
  std::array<Vec3, 4> rotatedGradients(const Mat3& rotation) const {
    return {rotation * gradient[0], rotation * gradient[1], rotation * gradient[2], rotation * gradient[3]};
  }
  Mat3 deformationGradient(const VecX& x) const {
    Mat3 f = x.segment<3>(3 * node[0]) * gradient[0].transpose();
    for (int k = 1; k < 4; ++k) f += x.segment<3>(3 * node[k]) * gradient[k].transpose();
    return f;
  }
};

/// What an elastic body remembers from step to step besides its positions.
struct ElasticState {
  std::vector<Mat3>
      rotations;  ///< one an element, of the last step's start: its next polar decomposition's first guess
  double stiffness_scale = 1.0;   ///< factor > 0 on all moduli; damping follows
  std::vector<FlatElement> flat;  ///< by element, of the positions that the rotations are for; not saved
  /// Elements in order that have wound twice about an edge and not been thick since: linear, so that they can turn
  /// over.
  std::vector<int> released;
};

/// Forces of one element on its nodes [N], and its energy [J].
struct ElementForces {
  std::array<Vec3, 4> force;
  double energy;
  bool thin;  ///< not isThick(); what a FlatElement adds is not in it
};

/// Rotations and forces at the end of a step, found with its energy: those of the next step's start. A cache: what it
/// holds is what would be found anew, to the bit.
struct ElasticAhead {
  VecX x;                              ///< positions that it is for; empty: none
  std::vector<Mat3> rotations;         ///< one an element
  std::vector<FlatElement> flat;       ///< by element
  std::vector<int> released;           ///< as in ElasticState
  VecX forces;                         ///< all nodes [N]
  std::vector<ElementForces> element;  ///< scratch
  std::vector<int> thin;               ///< scratch
  bool isFor(const VecX& positions) const { return x.size() == positions.size() && x == positions; }
  void clear() { x.resize(0); }
};

/// Elastic body on tetrahedra: knows nodes, nothing of handles, contact or time steps, and does not change. Positions
/// and forces are flat vectors of 3 coordinates a node [m], [N].
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

  /// The state at x, with polar decompositions from scratch.
  ElasticState stateAt(const VecX& x) const;
  /// Element rotations of the given positions (polar decomposition, started from the present ones), what is flat and
  /// what is released.
  void updateRotations(const VecX& x, ElasticState& state) const;
  /// Elastic forces at x with the state's rotations; overwrites f [3 nodes].
  void forces(const VecX& x, const ElasticState& state, VecX& f) const;
  /// Elastic energy at x with the state's rotations [J]; its gradient is -forces once the rotations are those of x.
  double energy(const VecX& x, const ElasticState& state) const;
  /// Elastic energy at x with the rotations of x [J], which stay in `ahead` with their forces and what is released
  /// then.
  double energyAt(const VecX& x, const ElasticState& state, ElasticAhead& ahead) const;

  /// Prepares assemble(): the pattern of the nodes with row[node] >= 0, which must number 0..n-1. While a model is
  /// built.
  SymmetricBlockMatrix pattern(const std::vector<int>& row);
  /// P of each element at x, times sqrt(scale), with the state's rotations, which must be those of x.
  void tensionFactors(const VecX& x, const ElasticState& state, double scale, std::vector<Mat3>& out) const;
  /// What fixed rotations leave out of K, for motions that are sums of a few shapes: shapes^T (d2 energy - K) shapes,
  /// [r x r], of either sign. Without what is pressed flat. The state's rotations must be those of x.
  /// @param row     of each node in the shapes; -1: it stays where it is
  /// @param shapes  [3 rows x r]
  MatX turningStiffness(const VecX& x, const ElasticState& state, const std::vector<int>& row,
                        const MatX& shapes) const;
  /// a = mass_scale M + stiffness_scale (K + sum B B^T) on the pattern's rows, with the state's rotations and flat
  /// elements.
  /// @param tension  P, one an element, or none
  void assemble(double mass_scale, double stiffness_scale, const ElasticState& state, SymmetricBlockMatrix& a,
                const std::vector<Mat3>& tension = {}) const;
  /// One of kParts shares of assemble(), which have no entry in common.
  void assemblePart(int part, double mass_scale, double stiffness_scale, const ElasticState& state,
                    SymmetricBlockMatrix& a, const std::vector<Mat3>& tension = {}) const;
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
  template <class Visit>
  void turnToFit(const VecX& x, int begin, int end, std::vector<Mat3>& rotations, Visit visit) const;
  void updateReleased(const VecX& x, const std::vector<int>& thin, std::vector<int>& released) const;
  std::vector<FlatElement> flatOnes(const VecX& x, const std::vector<int>& thin, const std::vector<int>& released,
                                    const std::vector<Mat3>& rotations) const;
  void addFlat(const std::vector<FlatElement>& flat, const std::vector<Mat3>& rotations, double scale, VecX& f) const;

  Material material_;
  EdgeWinding winding_;
  VecX mass_;
  std::vector<ElasticElement> elements_;
  std::vector<std::array<PairSlot, 10>> slots_;  // an element
  std::array<Part, kParts> parts_;
};

}  // namespace palpate
