#pragma once

#include <array>
#include <vector>

#include "palpate/math/types.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// How often the tetrahedra around an inner edge wind about it: once, unless violence has thrown nodes so that they do
/// twice, all of them right side out. Only tetrahedra that turn over can unwind them.
class EdgeWinding {
 public:
  EdgeWinding() = default;
  explicit EdgeWinding(const TetrahedralMesh& mesh);
  /// Appends the tetrahedra around each inner edge of that one about which they wind more than once, itself included.
  /// @param x  positions, 3 a node [m]
  void around(int tetrahedron, const VecX& x, std::vector<int>& out) const;
  int innerEdges() const { return static_cast<int>(ends_.size()); }

 private:
  double angle(int tetrahedron, const std::array<int, 2>& ends, const VecX& x) const;

  std::vector<std::array<int, 4>> tetrahedra_;
  std::vector<std::array<int, 2>> ends_;   // nodes of each inner edge
  std::vector<std::vector<int>> ring_;     // tetrahedra around it
  std::vector<std::array<int, 6>> edges_;  // inner edges of each tetrahedron; -1: none
};

}  // namespace palpate
