#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "palpate/contact/overlap.h"

namespace palpate {

/// What must not touch of two surfaces, such as those of bodies that are glued together: two features of which both
/// have a vertex that is marked.
struct PairExclusion {
  std::vector<char> first, second;  ///< of each vertex of the two surfaces: 1 where it is marked

  bool excludes(const std::array<int, 3>& of_first, const std::array<int, 3>& of_second) const {
    return marked(first, of_first) && marked(second, of_second);
  }
  bool excludes(const OverlapPoint& p) const {
    return p.of_first ? excludes(p.vertex, p.other_vertex) : excludes(p.other_vertex, p.vertex);
  }

 private:
  static bool marked(const std::vector<char>& marks, const std::array<int, 3>& vertices) {
    return std::any_of(vertices.begin(), vertices.end(),
                       [&](int v) { return v >= 0 && marks[static_cast<std::size_t>(v)] != 0; });
  }
};

/// Marks the vertices of triangles of `other` that are as near as that to a triangle of `surface` with a marked vertex,
/// where the surfaces start.
/// @param marks  of each vertex of `surface`
/// @param near   [m]
std::vector<char> marksNear(const CollisionSurface& surface, const std::vector<char>& marks,
                            const CollisionSurface& other, double near);

}  // namespace palpate
