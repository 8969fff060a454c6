#pragma once

#include <array>
#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// A tetrahedron cut into m^3 small ones of equal volume, m a side, such that neighbors' cuts match on their common
/// face. With corners (0,0,0), (m,0,0), (m,m,0), (m,m,m) the small ones are those of the Freudenthal grid that lie
/// inside.
class TetrahedronSubdivision {
 public:
  explicit TetrahedronSubdivision(int m);

  int side() const { return m_; }
  int count() const { return static_cast<int>(centers_.size()); }
  /// Barycentric coordinates of each small tetrahedron's center.
  const std::vector<Vec4>& centers() const { return centers_; }
  /// Pairs of small tetrahedra with a common face.
  const std::vector<std::array<int, 2>>& neighbors() const { return neighbors_; }

  struct FacePart {
    int part;                   ///< small tetrahedron
    std::array<int, 4> center;  ///< barycentric coordinates of its face's center, times 3 m
  };
  /// The m^2 small faces on the face opposite corner k.
  const std::vector<FacePart>& face(size_t k) const { return faces_[k]; }

  /// Small tetrahedron that holds a point inside, given its barycentric coordinates.
  int locate(const Vec4& weights) const;

 private:
  int m_;
  std::vector<Vec4> centers_;
  std::vector<std::array<int, 2>> neighbors_;
  std::array<std::vector<FacePart>, 4> faces_;
  std::vector<int> part_of_;  ///< by cube and order of the axes, -1 outside
};

}  // namespace palpate
