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

// Up to three points that span the patch: the deepest, the one farthest from it, the one farthest from the line of
// both.
void extremePoints(const std::vector<Contact>& all, const std::vector<int>& patch, std::vector<int>& out) {
  const auto deepest = *std::min_element(patch.begin(), patch.end(), [&](int a, int b) {
    return all[a].end_gap != all[b].end_gap ? all[a].end_gap < all[b].end_gap : a < b;
  });
  out.push_back(deepest);
  if (patch.size() == 1) return;
  const auto farthest = [&](auto distance) {
    int best = patch.front();
    double value = -1;
    for (const int i : patch) {
      const double d = distance(all[i].position);
      if (d > value) {
        value = d;
        best = i;
      }
    }
    return best;
  };
  const Vec3 origin = all[deepest].position;
  const int second = farthest([&](const Vec3& p) { return (p - origin).squaredNorm(); });
  if (second == deepest) return;
  out.push_back(second);
  if (patch.size() == 2) return;
  const Vec3 along = (all[second].position - origin).normalized();
  const int third = farthest([&](const Vec3& p) { return (p - origin).cross(along).squaredNorm(); });
  if (third != deepest && third != second) out.push_back(third);
}

// Position, gap and frame of a contact whose surface point is known.
void linearize(Contact& c, const VecX& x_start, const VecX& x_end, const Obstacle& obstacle, bool at_end) {
  const Vec3 start = interpolate(c.first.node, c.first.weight, x_start);
  const Vec3 end = interpolate(c.first.node, c.first.weight, x_end);
  const Proximity near_end = proximity(obstacle, end);
  c.position = end;
  c.end_gap = near_end.gap;
  if (at_end) {
    c.normal = near_end.normal;
    c.gap = near_end.gap - near_end.normal.dot(end - start);
  } else {
    const Proximity near_start = proximity(obstacle, start);
    c.normal = near_start.normal;
    c.gap = near_start.gap;
  }
  setTangents(c);
}

}  // namespace

void setTangents(Contact& contact) {
  const Vec3 axis = std::abs(contact.normal.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  contact.tangent1 = (axis - contact.normal.dot(axis) * contact.normal).normalized();
  contact.tangent2 = contact.normal.cross(contact.tangent1);
}

ContactFinder::ContactFinder(const SimulationMesh& mesh, double friction)
    : nodes_(static_cast<int>(mesh.mesh.nodes.size())), friction_(friction) {
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

double ContactFinder::clearance(const Group& group, const VecX& x, const Obstacle& obstacle) const {
  Vec3 center = Vec3::Zero();
  for (const int n : group.node) center += 0.25 * x.segment<3>(3 * n);
  double radius2 = 0;
  for (const int n : group.node) radius2 = std::max(radius2, (x.segment<3>(3 * n) - center).squaredNorm());
  return proximity(obstacle, center).gap - group.extension * std::sqrt(radius2);
}

void ContactFinder::find(int body, const VecX& x_start, const VecX& x_end, const std::vector<Obstacle>& obstacles,
                         double reach, bool linearize_at_end, std::vector<Contact>& out) const {
  for (int o = 0; o < static_cast<int>(obstacles.size()); ++o) {
    for (const Group& group : groups_) {
      if (!(clearance(group, x_end, obstacles[o]) < reach)) continue;
      for (int i = group.begin; i < group.end; ++i) {
        const Proximity at_end = proximity(obstacles[o], interpolate(group.node, weight_[i], x_end));
        if (!(at_end.gap < reach)) continue;
        Contact c;
        c.key = (static_cast<std::int64_t>(o) << 32) | static_cast<std::int64_t>(vertex_[i]);
        c.first = {body, group.node, weight_[i]};
        c.patch = group.tetrahedron;
        c.partner = o;
        c.friction = obstacles[o].friction.value_or(friction_);
        linearize(c, x_start, x_end, obstacles[o], linearize_at_end);
        out.push_back(c);
      }
    }
  }
}

Contact ContactFinder::follow(const Contact& earlier, const VecX& x_start, const VecX& x_end,
                              const std::vector<Obstacle>& obstacles) const {
  Contact c = earlier;
  linearize(c, x_start, x_end, obstacles[static_cast<std::size_t>(c.partner)], false);
  return c;
}

void ContactFinder::nearbyNodes(const VecX& x, const std::vector<Obstacle>& obstacles, double reach,
                                std::vector<int>& nodes) const {
  std::vector<char> seen(nodes_, 0);
  for (const Group& group : groups_) {
    for (const Obstacle& obstacle : obstacles) {
      if (!(clearance(group, x, obstacle) < reach)) continue;
      bool near = false;
      for (int i = group.begin; i < group.end && !near; ++i) {
        near = proximity(obstacle, interpolate(group.node, weight_[i], x)).gap < reach;
      }
      if (!near) continue;
      for (const int n : group.node) {
        if (!seen[n]) nodes.push_back(n);
        seen[n] = 1;
      }
      break;
    }
  }
}

std::vector<int> reduceContacts(const std::vector<Contact>& candidates, const std::vector<std::int64_t>& kept_keys,
                                double spacing) {
  std::vector<int> order(candidates.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return std::pair(candidates[a].partner, candidates[a].patch) <
           std::pair(candidates[b].partner, candidates[b].patch);
  });
  std::vector<int> proposals;
  std::vector<char> kept(candidates.size(), 0);
  std::vector<int> patch;
  for (std::size_t i = 0; i < order.size();) {
    patch.clear();
    const Contact& head = candidates[order[i]];
    for (; i < order.size() && candidates[order[i]].partner == head.partner && candidates[order[i]].patch == head.patch;
         ++i) {
      if (std::binary_search(kept_keys.begin(), kept_keys.end(), candidates[order[i]].key)) {
        kept[order[i]] = 1;
        proposals.push_back(order[i]);
      }
      patch.push_back(order[i]);
    }
    extremePoints(candidates, patch, proposals);
  }
  std::sort(proposals.begin(), proposals.end(), [&](int a, int b) {
    if (kept[a] != kept[b]) return kept[a] > kept[b];
    if (candidates[a].end_gap != candidates[b].end_gap) return candidates[a].end_gap < candidates[b].end_gap;
    return candidates[a].key < candidates[b].key;
  });
  std::vector<int> chosen;
  for (const int i : proposals) {
    const bool crowded = std::any_of(chosen.begin(), chosen.end(), [&](int j) {
      return i == j || (!kept[i] && candidates[j].partner == candidates[i].partner &&
                        (candidates[i].position - candidates[j].position).squaredNorm() < spacing * spacing);
    });
    if (!crowded) chosen.push_back(i);
  }
  return chosen;
}

}  // namespace palpate
