#include "palpate/contact/neighbor_exclusion.h"

#include <algorithm>

namespace palpate {

SelfExclusion excludeNeighbors(const CollisionSurface& surface, const std::vector<int>& tetrahedron,
                               const TetrahedralMesh& mesh) {
  std::vector<std::vector<int>> at_node(mesh.nodes.size());
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
    for (const int n : mesh.tetrahedra[t]) at_node[n].push_back(static_cast<int>(t));
  }
  std::vector<int> offset{0}, neighbor, around;
  for (const auto& nodes : mesh.tetrahedra) {
    around.clear();
    for (const int n : nodes) around.insert(around.end(), at_node[n].begin(), at_node[n].end());
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    neighbor.insert(neighbor.end(), around.begin(), around.end());
    offset.push_back(static_cast<int>(neighbor.size()));
  }
  return {surface, tetrahedron, offset, neighbor};
}

}  // namespace palpate
