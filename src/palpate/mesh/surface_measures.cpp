#include "palpate/mesh/surface_measures.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "palpate/common/error.h"
#include "palpate/mesh/edge_table.h"

namespace palpate {

std::vector<EdgeUse> edgeTable(const Surface& surface) {
  std::vector<EdgeUse> uses;
  uses.reserve(3 * surface.triangles.size());
  for (size_t t = 0; t < surface.triangles.size(); ++t) {
    for (size_t k = 0; k < 3; ++k) {
      const int a = surface.triangles[t][k];
      const int b = surface.triangles[t][(k + 1) % 3];
      uses.push_back({std::min(a, b), std::max(a, b), static_cast<int>(t), a < b});
    }
  }
  std::sort(uses.begin(), uses.end(), [](const EdgeUse& a, const EdgeUse& b) {
    return std::tie(a.low, a.high, a.triangle) < std::tie(b.low, b.high, b.triangle);
  });
  return uses;
}

Bounds boundsOf(const std::vector<Vec3>& points) {
  if (points.empty()) return {};
  Bounds box{points[0], points[0]};
  for (const Vec3& x : points) {
    box.low = box.low.cwiseMin(x);
    box.high = box.high.cwiseMax(x);
  }
  return box;
}

SurfaceMeasures measureSurface(const Surface& surface) {
  // Relative to the box's center, so that a surface far from the origin loses no digits.
  const Vec3 center = boundsOf(surface.vertices).center();
  SurfaceMeasures m;
  Vec3 first = Vec3::Zero();
  Mat3 second = Mat3::Zero();
  for (const auto& t : surface.triangles) {
    const Vec3 a = surface.vertices[static_cast<size_t>(t[0])] - center;
    const Vec3 b = surface.vertices[static_cast<size_t>(t[1])] - center;
    const Vec3 c = surface.vertices[static_cast<size_t>(t[2])] - center;
    const double det = a.dot(b.cross(c));
    const Vec3 sum = a + b + c;
    m.area += 0.5 * (b - a).cross(c - a).norm();
    m.volume += det / 6;
    first += det / 24 * sum;
    second += det / 120 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
  }
  m.center_of_mass = center;
  if (m.volume == 0) return m;
  const Vec3 mean = first / m.volume;
  const Mat3 covariance = second - m.volume * mean * mean.transpose();
  m.center_of_mass = center + mean;
  m.inertia = covariance.trace() * Mat3::Identity() - covariance;
  return m;
}

MassProperties surfaceMassProperties(const Surface& surface, double density, const std::string& name) {
  if (!(density > 0) || !std::isfinite(density)) throw InputError(name, "density", "must be positive and finite");
  const SurfaceMeasures solid = measureSurface(surface);
  const Eigen::SelfAdjointEigenSolver<Mat3> moments(solid.inertia, Eigen::EigenvaluesOnly);
  if (!(solid.volume > 0) || !(moments.eigenvalues().minCoeff() > 0))
    throw InputError(name, "", "bounds no volume; it must be closed and its triangles point outward");
  return {density * solid.volume, solid.center_of_mass, density * solid.inertia};
}

SurfaceTopology inspectTopology(const Surface& surface) {
  SurfaceTopology topology;
  const int n = static_cast<int>(surface.vertices.size());
  DisjointSets pieces(n);
  DisjointSets holes(n);
  std::vector<char> used(surface.vertices.size(), 0);
  std::vector<char> on_boundary(surface.vertices.size(), 0);
  for (const auto& t : surface.triangles) {
    for (int v : t) used[static_cast<size_t>(v)] = 1;
    pieces.unite(t[0], t[1]);
    pieces.unite(t[0], t[2]);
  }
  int edges = 0;
  forEachEdge(edgeTable(surface), [&](const EdgeUse* first, const EdgeUse* last) {
    ++edges;
    if (last - first == 1) {
      ++topology.boundary_edges;
      holes.unite(first->low, first->high);
      on_boundary[static_cast<size_t>(first->low)] = on_boundary[static_cast<size_t>(first->high)] = 1;
    }
    if (last - first > 2) ++topology.nonmanifold_edges;
    if (last - first == 2 && first[0].forward == first[1].forward) ++topology.inconsistent_edges;
  });
  int vertices = 0;
  for (int v = 0; v < n; ++v) {
    const auto i = static_cast<size_t>(v);
    vertices += used[i];
    if (used[i] && pieces.find(v) == v) ++topology.components;
    if (on_boundary[i] && holes.find(v) == v) ++topology.holes;
  }
  topology.euler = vertices - edges + static_cast<int>(surface.triangles.size());
  return topology;
}

Surface capHoles(const Surface& surface) {
  struct OpenEdge {
    int from, to, times;
  };
  std::vector<OpenEdge> open;
  forEachEdge(edgeTable(surface), [&](const EdgeUse* first, const EdgeUse* last) {
    int net = 0;
    for (const EdgeUse* use = first; use != last; ++use) net += use->forward ? 1 : -1;
    // The cap runs along the edge against the surplus.
    if (net > 0) open.push_back({first->high, first->low, net});
    if (net < 0) open.push_back({first->low, first->high, -net});
  });
  Surface capped = surface;
  if (open.empty()) return capped;

  DisjointSets holes(static_cast<int>(surface.vertices.size()));
  for (const OpenEdge& e : open) holes.unite(e.from, e.to);
  struct Apex {
    Vec3 sum = Vec3::Zero();
    int count = 0;
    int index = -1;
  };
  std::map<int, Apex> apexes;
  for (const OpenEdge& e : open) {
    Apex& apex = apexes[holes.find(e.from)];
    apex.sum += surface.vertices[static_cast<size_t>(e.from)] + surface.vertices[static_cast<size_t>(e.to)];
    apex.count += 2;
  }
  for (auto& [root, apex] : apexes) {
    apex.index = static_cast<int>(capped.vertices.size());
    capped.vertices.push_back(apex.sum / apex.count);
  }
  for (const OpenEdge& e : open) {
    const int apex = apexes[holes.find(e.from)].index;
    for (int i = 0; i < e.times; ++i) capped.triangles.push_back({e.from, e.to, apex});
  }
  return capped;
}

std::vector<Vec3> vertexNormals(const Surface& surface) {
  std::vector<Vec3> normals(surface.vertices.size(), Vec3::Zero());
  for (const auto& t : surface.triangles) {
    const Vec3& a = surface.vertices[static_cast<size_t>(t[0])];
    const Vec3 n =
        (surface.vertices[static_cast<size_t>(t[1])] - a).cross(surface.vertices[static_cast<size_t>(t[2])] - a);
    for (int v : t) normals[static_cast<size_t>(v)] += n;
  }
  for (Vec3& n : normals) {
    const double length = n.norm();
    n = length > 0 ? Vec3(n / length) : Vec3::Zero();
  }
  return normals;
}

}  // namespace palpate
