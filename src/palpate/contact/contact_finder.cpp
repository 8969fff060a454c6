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
    double size = 0;  // |sum w_k (x_k - c)| <= radius sum |w_k|
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

double ContactFinder::clearance(const Group& group, const VecX& x, const PlaneShape& plane) const {
  Vec3 center = Vec3::Zero();
  for (const int n : group.node) center += 0.25 * x.segment<3>(3 * n);
  double radius2 = 0;
  for (const int n : group.node) radius2 = std::max(radius2, (x.segment<3>(3 * n) - center).squaredNorm());
  return gap(plane, center) - group.extension * std::sqrt(radius2);
}

void ContactFinder::find(int body, const VecX& x_start, const VecX& x_end, const std::vector<Obstacle>& obstacles,
                         double reach, std::vector<Contact>& out) const {
  for (int o = 0; o < static_cast<int>(obstacles.size()); ++o) {
    const auto* plane = std::get_if<PlaneShape>(&obstacles[o].shape);
    if (plane == nullptr) continue;
    for (const Group& group : groups_) {
      if (!(clearance(group, x_end, *plane) < reach)) continue;
      for (int i = group.begin; i < group.end; ++i) {
        if (!(gap(*plane, interpolate(group.node, weight_[i], x_end)) < reach)) continue;
        Contact c;
        c.key = c.track = contactKey(static_cast<std::uint64_t>(body), static_cast<std::uint64_t>(o),
                                     static_cast<std::uint64_t>(vertex_[i]));
        c.first.body = body;
        for (int k = 0; k < 4; ++k) c.first.add(group.node[k], weight_[i][k]);
        c.patch = static_cast<std::uint64_t>(group.tetrahedron);
        c.partner = o;
        linearize(c, x_start, x_end, *plane);
        out.push_back(c);
      }
    }
  }
}

Contact ContactFinder::follow(const Contact& earlier, const VecX& x_start, const VecX& x_end,
                              const std::vector<Obstacle>& obstacles) const {
  Contact c = earlier;
  c.capped = false;
  linearize(c, x_start, x_end, std::get<PlaneShape>(obstacles[static_cast<std::size_t>(c.partner)].shape));
  return c;
}

void ContactFinder::nearbyNodes(const VecX& x, const std::vector<Obstacle>& obstacles, double reach,
                                std::vector<int>& nodes) const {
  for (const Group& group : groups_) {
    for (const Obstacle& obstacle : obstacles) {
      const auto* plane = std::get_if<PlaneShape>(&obstacle.shape);
      if (plane == nullptr || !(clearance(group, x, *plane) < reach)) continue;
      bool near = false;
      for (int i = group.begin; i < group.end && !near; ++i) {
        near = gap(*plane, interpolate(group.node, weight_[i], x)) < reach;
      }
      if (!near) continue;
      nodes.insert(nodes.end(), group.node.begin(), group.node.end());
      break;
    }
  }
}

}  // namespace palpate
