#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/contact/obstacle.h"
#include "palpate/math/types.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// A surface vertex near a plane.
struct VertexNearPlane {
  double gap;         ///< [m]
  std::uint64_t key;  ///< of the contact that it would be
  int obstacle;
  int group, vertex;  ///< ContactFinder's own
};

/// Finds where the embedded surface of one body comes close to planes: its vertices tell all there is to know. Leaves
/// friction to the caller; other obstacles are skipped.
class ContactFinder {
 public:
  ContactFinder() = default;
  explicit ContactFinder(const SimulationMesh& mesh);

  /// Surface vertices whose gap at x_end is below reach.
  /// @param x_start, x_end  node positions, flat [m]
  void find(int body, const VecX& x_start, const VecX& x_end, const std::vector<Obstacle>& obstacles, double reach,
            std::vector<Contact>& out) const;

  /// The same without making contacts, where there may be thousands of which few are wanted; at x. Appends.
  void find(int body, const VecX& x, const std::vector<Obstacle>& obstacles, double reach,
            std::vector<VertexNearPlane>& out) const;
  /// The contact that one of them is.
  Contact contact(int body, const VertexNearPlane& near, const VecX& x_start, const VecX& x_end,
                  const std::vector<Obstacle>& obstacles) const;

  /// The same surface vertex against the same plane as in an earlier step, wherever it now is.
  Contact follow(const Contact& earlier, const VecX& x_start, const VecX& x_end,
                 const std::vector<Obstacle>& obstacles) const;

  /// Tetrahedra with a surface vertex within reach of a plane at x; appends their nodes, some more than once.
  void nearbyNodes(const VecX& x, const std::vector<Obstacle>& obstacles, double reach, std::vector<int>& nodes) const;

  /// Mean edge length of the simulation mesh [m].
  double edgeLength() const { return edge_length_; }

 private:
  struct Group {  // the surface vertices of one tetrahedron
    int tetrahedron;
    std::array<int, 4> node;
    int begin, end;    // range in vertex_
    double extension;  // largest sum of a vertex's absolute weights
  };
  void measure(const VecX& x, const PlaneShape& plane) const;
  double clearance(const Group& group) const;

  std::vector<Group> groups_;
  std::vector<int> vertex_;
  std::vector<std::array<double, 4>> weight_;  // as vertex_
  mutable std::vector<double> gap_;            // of each node, while one plane is looked at [m]
  mutable std::vector<VertexNearPlane> near_;
  double edge_length_ = 0;
};

}  // namespace palpate
