#include "palpate/contact/contact_finder.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate {
namespace {

Vec3 interpolate(const std::array<int, 4>& node, const std::array<double, 4>& weight, const VecX& x) {
  return weight[0] * x.segment<3>(3 * node[0]) + weight[1] * x.segment<3>(3 * node[1]) +
         weight[2] * x.segment<3>(3 * node[2]) + weight[3] * x.segment<3>(3 * node[3]);
}

// Position, gap and frame of a contact whose surface point is known. A plane's normal is the same everywhere, so the
// gap is linear in the motion and it does not matter where it is linearized.
void linearize(Contact& c, const VecX& x_start, const VecX& x_end, const PlaneShape& plane) {
  c.position = c.first.at(x_end);
  c.end_gap = gap(plane, c.position);
  c.gap = gap(plane, c.first.at(x_start));
  c.normal = plane.normal;
  setTangents(c);
}

}  // namespace

ContactFinder::ContactFinder(const SimulationMesh& mesh) {
  vertex_.resize(mesh.embedding.size());
  std::iota(vertex_.begin(), vertex_.end(), 0);
  std::stable_sort(vertex_.begin(), vertex_.end(),
                   [&](int a, int b) { return mesh.embedding[a].tetrahedron < mesh.embedding[b].tetrahedron; });
  weight_.reserve(vertex_.size());
  for (int i = 0; i < static_cast<int>(vertex_.size()); ++i) {
    const EmbeddedPoint& point = mesh.embedding[vertex_[i]];
    weight_.push_back(point.weights);
    if (groups_.empty() || groups_.back().tetrahedron != point.tetrahedron) {
      groups_.push_back({point.tetrahedron, mesh.mesh.tetrahedra[point.tetrahedron], i, i, 1.0});
    }
    groups_.back().end = i + 1;
    double size = 0;
    for (const double w : point.weights) size += std::abs(w);
    groups_.back().extension = std::max(groups_.back().extension, size);
  }
  double sum = 0;
  for (const auto& t : mesh.mesh.tetrahedra) {
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < i; ++j) sum += (mesh.mesh.nodes[t[i]] - mesh.mesh.nodes[t[j]]).norm();
    }
  }
  edge_length_ = sum / (6.0 * static_cast<double>(mesh.mesh.tetrahedra.size()));
}

// Gaps of all nodes: those of vertices are their weighted sums.
void ContactFinder::measure(const VecX& x, const PlaneShape& plane) const {
  gap_.resize(static_cast<std::size_t>(x.size() / 3));
  for (std::size_t n = 0; n < gap_.size(); ++n) {
    gap_[n] = gap(plane, x.segment<3>(static_cast<Eigen::Index>(3 * n)));
  }
}

// Lower bound of the vertices' gaps: with m the middle of the nodes' gaps g_k, sum w_k (g_k - m) is at least
// -max |g_k - m| sum |w_k|.
double ContactFinder::clearance(const Group& group) const {
  const double a = gap_[group.node[0]], b = gap_[group.node[1]], c = gap_[group.node[2]], d = gap_[group.node[3]];
  const double low = std::min(std::min(a, b), std::min(c, d)), high = std::max(std::max(a, b), std::max(c, d));
  return 0.5 * ((low + high) - group.extension * (high - low));
}

void ContactFinder::find(int body, const VecX& x, const std::vector<Obstacle>& obstacles, double reach,
                         std::vector<VertexNearPlane>& out) const {
  for (int o = 0; o < static_cast<int>(obstacles.size()); ++o) {
    const auto* plane = std::get_if<PlaneShape>(&obstacles[o].shape);
    if (plane == nullptr) continue;
    measure(x, *plane);
    for (int g = 0; g < static_cast<int>(groups_.size()); ++g) {
      const Group& group = groups_[g];
      if (!(clearance(group) < reach)) continue;
      for (int i = group.begin; i < group.end; ++i) {
        const double distance = gap(*plane, interpolate(group.node, weight_[i], x));
        if (!(distance < reach)) continue;
        const std::uint64_t key = contactKey(static_cast<std::uint64_t>(body), static_cast<std::uint64_t>(o),
                                             static_cast<std::uint64_t>(vertex_[i]));
        out.push_back({distance, key, o, g, i});
      }
    }
  }
}

Contact ContactFinder::contact(int body, const VertexNearPlane& near, const VecX& x_start, const VecX& x_end,
                               const std::vector<Obstacle>& obstacles) const {
  const Group& group = groups_[near.group];
  Contact c;
  c.key = c.track = near.key;
  c.first.body = body;
  for (int k = 0; k < 4; ++k) c.first.add(group.node[k], weight_[near.vertex][k]);
  c.patch = static_cast<std::uint64_t>(group.tetrahedron);
  c.partner = near.obstacle;
  linearize(c, x_start, x_end, std::get<PlaneShape>(obstacles[static_cast<std::size_t>(near.obstacle)].shape));
  return c;
}

void ContactFinder::find(int body, const VecX& x_start, const VecX& x_end, const std::vector<Obstacle>& obstacles,
                         double reach, std::vector<Contact>& out) const {
  near_.clear();
  find(body, x_end, obstacles, reach, near_);
  for (const VertexNearPlane& near : near_) out.push_back(contact(body, near, x_start, x_end, obstacles));
}

Contact ContactFinder::follow(const Contact& earlier, const VecX& x_start, const VecX& x_end,
                              const std::vector<Obstacle>& obstacles) const {
  Contact c = earlier;
  c.follows = 1;
  linearize(c, x_start, x_end, std::get<PlaneShape>(obstacles[static_cast<std::size_t>(c.partner)].shape));
  return c;
}

void ContactFinder::nearbyNodes(const VecX& x, const std::vector<Obstacle>& obstacles, double reach,
                                std::vector<int>& nodes) const {
  for (const Obstacle& obstacle : obstacles) {
    const auto* plane = std::get_if<PlaneShape>(&obstacle.shape);
    if (plane == nullptr) continue;
    measure(x, *plane);
    for (const Group& group : groups_) {
      if (!(clearance(group) < reach)) continue;
      const auto near = [&](const std::array<double, 4>& w) {
        double sum = 0;
        for (int k = 0; k < 4; ++k) sum += w[k] * gap_[group.node[k]];
        return sum < reach;
      };
      if (std::any_of(weight_.begin() + group.begin, weight_.begin() + group.end, near))
        nodes.insert(nodes.end(), group.node.begin(), group.node.end());
    }
  }
}

}  // namespace palpate
