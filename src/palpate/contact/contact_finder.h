#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "palpate/contact/obstacle.h"
#include "palpate/math/types.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// A material point of one body: x = sum_k weight[k] x(node[k]).
struct ContactPoint {
  int body = -1;  ///< index in the world; -1: fixed geometry, which has no unknowns
  std::array<int, 4> node{};
  std::array<double, 4> weight{};
};

/// One unilateral contact with friction: gap + h normal . (v_first - v_second) >= 0.
struct Contact {
  std::int64_t key = 0;  ///< same for the same pair of features in the next step; carries impulses over
  ContactPoint first;
  ContactPoint second;
  Vec3 normal;    ///< unit, from second to first
  Vec3 tangent1;  ///< unit; the linearized cone's first vertex lies along it
  Vec3 tangent2;
  double gap = 0;       ///< at the start of the step, linearized along the normal [m]
  double friction = 0;  ///< Coulomb coefficient
  int patch = 0;        ///< tetrahedron of the first body: one affine piece of its surface
  int partner = 0;      ///< obstacle (or other body's tetrahedron)
  Vec3 position;        ///< of the point at the end of the (predicted) step [m]
  double end_gap = 0;   ///< gap there [m]

  /// Rows normal, tangent1, tangent2.
  Mat3 frame() const {
    Mat3 f;
    f.row(0) = normal.transpose();
    f.row(1) = tangent1.transpose();
    f.row(2) = tangent2.transpose();
    return f;
  }
};

/// Tangents of a contact frame: the first is world x made tangent to the contact (world y where the normal is along x),
/// so the linearized cone is exact for sliding along world x or y on level ground.
void setTangents(Contact& contact);

/// Finds where the embedded surface of one body comes close to fixed obstacles.
class ContactFinder {
 public:
  ContactFinder() = default;
  /// @param friction  of the body, against obstacles that have no coefficient of their own
  ContactFinder(const SimulationMesh& mesh, double friction);

  /// Surface vertices whose gap at x_end is below reach. Gaps are linearized at the start positions or, for
  /// linearize_at_end, at the end positions (for what the first linearization missed).
  /// @param x_start, x_end  node positions, flat [m]
  void find(int body, const VecX& x_start, const VecX& x_end, const std::vector<Obstacle>& obstacles, double reach,
            bool linearize_at_end, std::vector<Contact>& out) const;

  /// The same surface vertex against the same obstacle as in an earlier step, wherever it now is.
  Contact follow(const Contact& earlier, const VecX& x_start, const VecX& x_end,
                 const std::vector<Obstacle>& obstacles) const;

  /// Tetrahedra with a surface vertex within reach of an obstacle at x; appends their nodes, each at most once.
  void nearbyNodes(const VecX& x, const std::vector<Obstacle>& obstacles, double reach, std::vector<int>& nodes) const;

  /// Mean edge length of the simulation mesh [m].
  double edgeLength() const { return edge_length_; }

 private:
  struct Group {  // the surface vertices of one tetrahedron
    int tetrahedron;
    std::array<int, 4> node;
    int begin, end;    // range in vertex_
    double extension;  // how far outside its tetrahedron a vertex may lie, as a factor on its radius
  };
  double clearance(const Group& group, const VecX& x, const Obstacle& obstacle) const;

  std::vector<Group> groups_;
  std::vector<int> vertex_;
  std::vector<std::array<double, 4>> weight_;  // as vertex_
  int nodes_ = 0;
  double friction_ = 0;
  double edge_length_ = 0;
};

/// Chooses from all candidates a small, well-spread set. In one tetrahedron the surface moves affinely, so against a
/// plane a few extreme points of its patch bound all others; patches overlap in the nodes they share, so points nearer
/// to each other than `spacing` are thinned, deepest first. Those in `kept_keys` (sorted: contacts that carried force
/// in the last step) come before all others. What the choice misses is found by the check at the end of the step and
/// added.
/// @returns indices into candidates, in order of choice
std::vector<int> reduceContacts(const std::vector<Contact>& candidates, const std::vector<std::int64_t>& kept_keys,
                                double spacing);

}  // namespace palpate
