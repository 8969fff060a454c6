#include "palpate/contact/neighbor_exclusion.h"

#include <algorithm>

#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

constexpr double kRunsOn = 0.25;  // mean edges between boxes of a surface that runs on from one to the other

std::vector<int> sortedUnique(std::vector<int> v) {
  std::sort(v.begin(), v.end());
  v.erase(std::unique(v.begin(), v.end()), v.end());
  return v;
}

// For each tetrahedron those that share a node with it, itself included, in order.
std::vector<std::vector<int>> nodeNeighbors(const TetrahedralMesh& mesh) {
  std::vector<std::vector<int>> at_node(mesh.nodes.size());
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
    for (const int n : mesh.tetrahedra[t]) at_node[n].push_back(static_cast<int>(t));
  }
  std::vector<std::vector<int>> ring(mesh.tetrahedra.size());
  for (std::size_t t = 0; t < ring.size(); ++t) {
    for (const int n : mesh.tetrahedra[t]) ring[t].insert(ring[t].end(), at_node[n].begin(), at_node[n].end());
    ring[t] = sortedUnique(std::move(ring[t]));
  }
  return ring;
}

// Boxes of the surface's triangles in each tetrahedron, at rest; a triangle counts to that of its first vertex.
struct SurfaceBoxes {
  std::vector<Bounds> box;
  std::vector<char> filled;

  SurfaceBoxes(const CollisionSurface& surface, const std::vector<int>& tetrahedron, std::size_t tetrahedra)
      : box(tetrahedra), filled(tetrahedra, 0) {
    for (const auto& t : surface.triangles()) {
      const int group = tetrahedron[t[0]];
      for (const int v : t) {
        const Vec3& p = surface.rest()[v];
        box[group].low = filled[group] ? Vec3(box[group].low.cwiseMin(p)) : p;
        box[group].high = filled[group] ? Vec3(box[group].high.cwiseMax(p)) : p;
        filled[group] = 1;
      }
    }
  }
  bool within(double distance, std::size_t t, std::size_t other) const {
    if (!filled[t] || !filled[other]) return false;
    const Bounds &a = box[t], &b = box[other];
    const Vec3 apart = (a.low - b.high).cwiseMax(b.low - a.high).cwiseMax(0.0);
    return apart.norm() < distance;
  }
};

}  // namespace

SelfExclusion excludeNeighbors(const CollisionSurface& surface, const std::vector<int>& tetrahedron,
                               const TetrahedralMesh& mesh) {
  const std::vector<std::vector<int>> ring = nodeNeighbors(mesh);
  const SurfaceBoxes boxes(surface, tetrahedron, mesh.tetrahedra.size());
  const double gap = kRunsOn * meanEdge(mesh);
  std::vector<int> offset{0}, neighbor, around;
  for (std::size_t t = 0; t < ring.size(); ++t) {
    around = ring[t];
    for (const int near : ring[t]) {
      for (const int far : ring[near]) {
        if (boxes.within(gap, t, static_cast<std::size_t>(far))) around.push_back(far);
      }
    }
    around = sortedUnique(std::move(around));
    neighbor.insert(neighbor.end(), around.begin(), around.end());
    offset.push_back(static_cast<int>(neighbor.size()));
  }
  return {surface, tetrahedron, offset, neighbor};
}

}  // namespace palpate
