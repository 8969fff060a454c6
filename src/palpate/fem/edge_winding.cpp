#include "palpate/fem/edge_winding.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "palpate/mesh/mesh_quality.h"

namespace palpate {

EdgeWinding::EdgeWinding(const TetrahedralMesh& mesh) : tetrahedra_(mesh.tetrahedra) {
  std::vector<std::pair<std::array<int, 2>, int>> edges;  // with a tetrahedron each
  for (std::size_t t = 0; t < tetrahedra_.size(); ++t) {
    std::array<int, 4> n = tetrahedra_[t];
    std::sort(n.begin(), n.end());
    for (int i = 0; i < 4; ++i) {
      for (int j = i + 1; j < 4; ++j) edges.push_back({{n[i], n[j]}, static_cast<int>(t)});
    }
  }
  std::sort(edges.begin(), edges.end());
  edges_.assign(tetrahedra_.size(), {-1, -1, -1, -1, -1, -1});
  // at an inner edge every face has a tetrahedron on both sides, so there are as many nodes around it as tetrahedra
  std::vector<int> nodes;
  for (auto begin = edges.begin(); begin != edges.end();) {
    const auto end = std::find_if(begin, edges.end(), [&](const auto& e) { return e.first != begin->first; });
    nodes.clear();
    for (auto e = begin; e != end; ++e) {
      for (const int n : tetrahedra_[static_cast<std::size_t>(e->second)]) {
        if (n != begin->first[0] && n != begin->first[1]) nodes.push_back(n);
      }
    }
    std::sort(nodes.begin(), nodes.end());
    bool inner = true;
    for (std::size_t i = 0; i < nodes.size(); i += 2) inner = inner && nodes[i] == nodes[i + 1];
    if (inner) {
      ring_.emplace_back();
      for (auto e = begin; e != end; ++e) {
        ring_.back().push_back(e->second);
        auto& own = edges_[static_cast<std::size_t>(e->second)];
        *std::find(own.begin(), own.end(), -1) = static_cast<int>(ends_.size());
      }
      ends_.push_back(begin->first);
    }
    begin = end;
  }
}

// Dihedral angle at the edge, negative where the tetrahedron is turned over.
double EdgeWinding::angle(int tetrahedron, const std::array<int, 2>& ends, const VecX& x) const {
  const std::array<int, 4>& t = tetrahedra_[static_cast<std::size_t>(tetrahedron)];
  const auto at = [&](int node) { return Vec3(x.segment<3>(3 * static_cast<Eigen::Index>(node))); };
  const Vec3 origin = at(ends[0]), along = (at(ends[1]) - origin).normalized();
  std::array<Vec3, 2> side;
  std::size_t n = 0;
  for (const int node : t) {
    if (node == ends[0] || node == ends[1]) continue;
    const Vec3 d = at(node) - origin;
    side[n++] = d - along * along.dot(d);
  }
  const double size = std::atan2(side[0].cross(side[1]).norm(), side[0].dot(side[1]));
  return isTurnedOver(t, x) ? -size : size;
}

void EdgeWinding::around(int tetrahedron, const VecX& x, std::vector<int>& out) const {
  constexpr double kMoreThanOnce = 1.5 * 2 * std::numbers::pi;
  for (const int edge : edges_[static_cast<std::size_t>(tetrahedron)]) {
    if (edge < 0) break;
    const std::vector<int>& ring = ring_[static_cast<std::size_t>(edge)];
    double sum = 0;
    for (const int t : ring) sum += angle(t, ends_[static_cast<std::size_t>(edge)], x);
    if (sum > kMoreThanOnce) out.insert(out.end(), ring.begin(), ring.end());
  }
}

}  // namespace palpate
