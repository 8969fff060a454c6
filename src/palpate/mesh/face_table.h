#pragma once

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace palpate {

/// A tetrahedron's use of a face: the face's three corners, ascending, and the tetrahedron's index.
using FaceUse = std::pair<std::array<int, 3>, int>;

/// All face uses of tetrahedra given by their four corners, sorted, so that the uses of one face are neighbors.
inline std::vector<FaceUse> faceTable(const std::vector<std::array<int, 4>>& tetrahedra) {
  std::vector<FaceUse> uses;
  uses.reserve(4 * tetrahedra.size());
  for (size_t i = 0; i < tetrahedra.size(); ++i) {
    const auto& t = tetrahedra[i];
    for (size_t k = 0; k < 4; ++k) {
      std::array<int, 3> face = {t[(k + 1) % 4], t[(k + 2) % 4], t[(k + 3) % 4]};
      std::sort(face.begin(), face.end());
      uses.emplace_back(face, static_cast<int>(i));
    }
  }
  std::sort(uses.begin(), uses.end());
  return uses;
}

}  // namespace palpate
