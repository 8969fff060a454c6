#pragma once

// What is wrong with a surface or an embedding: fused limbs, damage, complaints.

#include <algorithm>
#include <queue>
#include <random>
#include <set>
#include <vector>

#include "palpate/mesh/edge_table.h"
#include "palpate/mesh/types.h"

namespace palpate::test {

/// Whether paths along the surface's edges no longer than `limit` [m] lead from the first of the vertices to all
/// others.
inline bool allWithin(const Surface& s, const std::vector<std::vector<int>>& neighbors, const std::vector<int>& targets,
                      double limit, std::vector<double>& length) {
  std::set<int> missing(targets.begin(), targets.end());
  std::vector<int> touched = {targets.front()};
  using Entry = std::pair<double, int>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  length[static_cast<size_t>(targets.front())] = 0;
  queue.push({0, targets.front()});
  while (!queue.empty() && !missing.empty()) {
    const auto [d, v] = queue.top();
    queue.pop();
    if (d > length[static_cast<size_t>(v)]) continue;
    missing.erase(v);
    for (int w : neighbors[static_cast<size_t>(v)]) {
      const double e = d + (s.vertices[static_cast<size_t>(v)] - s.vertices[static_cast<size_t>(w)]).norm();
      if (e >= length[static_cast<size_t>(w)] || e > limit) continue;
      length[static_cast<size_t>(w)] = e;
      touched.push_back(w);
      queue.push({e, w});
    }
  }
  for (int v : touched) length[static_cast<size_t>(v)] = 1e300;
  return missing.empty();
}

/// Tetrahedra that carry two surface vertices whose path along the surface is longer than `limit` [m]. (From the first
/// vertex of each tetrahedron: by the triangle inequality no pair is more than twice as far.)
inline int fusedTetrahedra(const SimulationMesh& m, double limit) {
  std::vector<std::vector<int>> neighbors(m.surface.vertices.size());
  for (const auto& t : m.surface.triangles)
    for (size_t k = 0; k < 3; ++k) {
      neighbors[static_cast<size_t>(t[k])].push_back(t[(k + 1) % 3]);
      neighbors[static_cast<size_t>(t[k])].push_back(t[(k + 2) % 3]);
    }
  std::vector<std::vector<int>> carried(m.mesh.tetrahedra.size());
  for (size_t v = 0; v < m.embedding.size(); ++v)
    carried[static_cast<size_t>(m.embedding[v].tetrahedron)].push_back(static_cast<int>(v));
  int fused = 0;
  std::vector<double> length(m.surface.vertices.size(), 1e300);
  for (const auto& list : carried) {
    if (list.empty()) continue;
    fused += !allWithin(m.surface, neighbors, list, limit, length);
  }
  return fused;
}

/// 2 % of the triangles gone, 10 % turned round, every triangle with vertices of its own.
inline Surface damaged(const Surface& s, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  Surface bad;
  for (auto t : s.triangles) {
    if (uniform(random) < 0.02) continue;
    if (uniform(random) < 0.10) std::swap(t[0], t[1]);
    const int base = static_cast<int>(bad.vertices.size());
    for (int v : t) bad.vertices.push_back(s.vertices[static_cast<size_t>(v)]);
    bad.triangles.push_back({base, base + 1, base + 2});
  }
  return bad;
}

/// What holds for every simulation mesh; returns complaints.
inline std::string complaintsAbout(const SimulationMesh& m) {
  std::string text;
  const auto complain = [&](bool wrong, const char* what) {
    if (wrong) text += std::string(what) + "; ";
  };
  complain(m.fill.size() != m.mesh.tetrahedra.size() || m.share.size() != m.fill.size(), "sizes of fill and share");
  complain(m.fill.empty() || m.embedding.empty(), "nothing there");
  complain(m.embedding.size() != m.surface.vertices.size(), "size of embedding");
  bool sums = true, range = true, positive = true, places = true, weights = true;
  for (size_t t = 0; t < m.fill.size(); ++t) {
    double sum = 0;
    for (double s : m.share[t]) {
      sum += s;
      range = range && s >= 0;
    }
    sums = sums && std::abs(sum - m.fill[t]) < 1e-12;
    range = range && m.fill[t] > 0 && m.fill[t] <= 1 + 1e-12;
    const auto& n = m.mesh.tetrahedra[t];
    const Vec3& x0 = m.mesh.nodes[static_cast<size_t>(n[0])];
    positive = positive && (m.mesh.nodes[static_cast<size_t>(n[1])] - x0)
                                   .cross(m.mesh.nodes[static_cast<size_t>(n[2])] - x0)
                                   .dot(m.mesh.nodes[static_cast<size_t>(n[3])] - x0) > 0;
  }
  for (size_t v = 0; v < m.embedding.size(); ++v) {
    Vec3 x = Vec3::Zero();
    double sum = 0;
    for (size_t k = 0; k < 4; ++k) {
      const double w = m.embedding[v].weights[k];
      sum += w;
      weights = weights && w > -0.6;
      x += w * m.mesh.nodes[static_cast<size_t>(m.mesh.tetrahedra[static_cast<size_t>(m.embedding[v].tetrahedron)][k])];
    }
    weights = weights && std::abs(sum - 1) < 1e-9;
    places = places && (x - m.surface.vertices[v]).norm() < 1e-9 * (1 + x.norm());
  }
  complain(!sums, "share does not sum to fill");
  complain(!range, "fill or share out of range");
  complain(!positive, "inverted tetrahedron");
  complain(!places, "embedded points off their places");
  complain(!weights, "weights");
  return text;
}

}  // namespace palpate::test
