#include "palpate/mesh/shapes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>
#include <utility>

#include "palpate/common/error.h"

namespace palpate {
namespace {

constexpr long long kLargestGrid = 4'000'000;

void requirePositive(const char* shape, const char* key, double value) {
  if (!(value > 0) || !std::isfinite(value)) throw InputError(shape, key, "must be positive and finite");
}

void requireCells(const char* shape, const std::array<int, 3>& cells) {
  long long product = 1;
  for (int c : cells) {
    if (c < 1 || c > kLargestGrid) throw InputError(shape, "cells", "must be at least 1 in each direction");
    product *= c;
    if (product > kLargestGrid) throw InputError(shape, "cells", "at most 4,000,000 cells");
  }
}

double signedVolume6(const TetrahedralMesh& mesh, const std::array<int, 4>& t) {
  const Vec3& x0 = mesh.nodes[static_cast<size_t>(t[0])];
  return (mesh.nodes[static_cast<size_t>(t[1])] - x0)
      .cross(mesh.nodes[static_cast<size_t>(t[2])] - x0)
      .dot(mesh.nodes[static_cast<size_t>(t[3])] - x0);
}

}  // namespace

BoundarySurface boundaryOf(const TetrahedralMesh& mesh) {
  // The face opposite each node, counter-clockwise from outside for a positive tetrahedron.
  constexpr int faces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  struct Face {
    std::array<int, 3> key;
    std::array<int, 3> oriented;
  };
  std::vector<Face> all;
  all.reserve(4 * mesh.tetrahedra.size());
  for (const auto& t : mesh.tetrahedra) {
    for (const auto& f : faces) {
      std::array<int, 3> v = {t[static_cast<size_t>(f[0])], t[static_cast<size_t>(f[1])], t[static_cast<size_t>(f[2])]};
      std::array<int, 3> key = v;
      std::sort(key.begin(), key.end());
      all.push_back({key, v});
    }
  }
  std::sort(all.begin(), all.end(),
            [](const Face& a, const Face& b) { return std::tie(a.key, a.oriented) < std::tie(b.key, b.oriented); });
  BoundarySurface boundary;
  std::vector<int> local(mesh.nodes.size(), -1);
  for (size_t i = 0; i < all.size();) {
    size_t j = i + 1;
    while (j < all.size() && all[j].key == all[i].key) ++j;
    if (j - i == 1) {
      std::array<int, 3> t = all[i].oriented;
      for (int& v : t) {
        int& l = local[static_cast<size_t>(v)];
        if (l < 0) {
          l = static_cast<int>(boundary.nodes.size());
          boundary.nodes.push_back(v);
          boundary.surface.vertices.push_back(mesh.nodes[static_cast<size_t>(v)]);
        }
        v = l;
      }
      boundary.surface.triangles.push_back(t);
    }
    i = j;
  }
  return boundary;
}

SimulationMesh simulationMeshOf(TetrahedralMesh mesh, const std::string& name) {
  if (mesh.tetrahedra.empty()) throw InputError(name, "", "has no tetrahedra");
  for (const Vec3& x : mesh.nodes)
    if (!x.allFinite()) throw InputError(name, "", "has a node that is not finite");
  std::vector<std::pair<int, double>> corner(mesh.nodes.size(), {-1, 0.0});
  for (size_t i = 0; i < mesh.tetrahedra.size(); ++i) {
    auto& t = mesh.tetrahedra[i];
    for (int v : t)
      if (v < 0 || static_cast<size_t>(v) >= mesh.nodes.size())
        throw InputError(name, "tetrahedron " + std::to_string(i + 1), "node index out of range");
    double longest = 0;
    for (size_t a = 0; a < 4; ++a)
      for (size_t b = a + 1; b < 4; ++b)
        longest =
            std::max(longest, (mesh.nodes[static_cast<size_t>(t[a])] - mesh.nodes[static_cast<size_t>(t[b])]).norm());
    if (signedVolume6(mesh, t) < 0) std::swap(t[2], t[3]);
    if (!(signedVolume6(mesh, t) > 1e-9 * longest * longest * longest))
      throw InputError(name, "tetrahedron " + std::to_string(i + 1), "has no volume");
    for (size_t k = 0; k < 4; ++k) corner[static_cast<size_t>(t[k])] = {static_cast<int>(i), static_cast<double>(k)};
  }
  SimulationMesh result;
  BoundarySurface boundary = boundaryOf(mesh);
  result.fill.assign(mesh.tetrahedra.size(), 1.0);
  result.share.assign(mesh.tetrahedra.size(), {0.25, 0.25, 0.25, 0.25});
  for (int node : boundary.nodes) {
    EmbeddedPoint point;
    point.tetrahedron = corner[static_cast<size_t>(node)].first;
    point.weights[static_cast<size_t>(corner[static_cast<size_t>(node)].second)] = 1;
    result.embedding.push_back(point);
  }
  result.surface = std::move(boundary.surface);
  result.mesh = std::move(mesh);
  return result;
}

SimulationMesh barMesh(const Vec3& size, const std::array<int, 3>& cells) {
  for (int d = 0; d < 3; ++d) requirePositive("bar", "size", size[d]);
  requireCells("bar", cells);
  TetrahedralMesh mesh;
  const auto node = [&](int i, int j, int k) { return i + (cells[0] + 1) * (j + (cells[1] + 1) * k); };
  for (int k = 0; k <= cells[2]; ++k)
    for (int j = 0; j <= cells[1]; ++j)
      for (int i = 0; i <= cells[0]; ++i)
        mesh.nodes.push_back({size.x() * i / cells[0], size.y() * j / cells[1], size.z() * k / cells[2]});
  // From corner (0,0,0) to (1,1,1) along the axes in each of the six orders.
  std::array<int, 3> order = {0, 1, 2};
  std::vector<std::array<std::array<int, 3>, 4>> paths;
  do {
    std::array<std::array<int, 3>, 4> path{};
    for (size_t s = 0; s < 3; ++s) {
      path[s + 1] = path[s];
      ++path[s + 1][static_cast<size_t>(order[s])];
    }
    const bool even = (order[1] - order[0] + 3) % 3 == 1;
    if (!even) std::swap(path[1], path[2]);
    paths.push_back(path);
  } while (std::next_permutation(order.begin(), order.end()));
  for (int k = 0; k < cells[2]; ++k)
    for (int j = 0; j < cells[1]; ++j)
      for (int i = 0; i < cells[0]; ++i)
        for (const auto& p : paths) {
          std::array<int, 4> t{};
          for (size_t s = 0; s < 4; ++s) t[s] = node(i + p[s][0], j + p[s][1], k + p[s][2]);
          mesh.tetrahedra.push_back(t);
        }
  return simulationMeshOf(std::move(mesh), "bar");
}

Surface boxSurface(const Vec3& size, const std::array<int, 3>& cells) {
  for (int d = 0; d < 3; ++d) requirePositive("box", "size", size[d]);
  requireCells("box", cells);
  Surface surface;
  std::map<std::array<int, 3>, int> index;
  const auto vertex = [&](const std::array<int, 3>& p) {
    const auto [it, fresh] = index.try_emplace(p, static_cast<int>(surface.vertices.size()));
    if (fresh)
      surface.vertices.push_back({size.x() * (double(p[0]) / cells[0] - 0.5),
                                  size.y() * (double(p[1]) / cells[1] - 0.5),
                                  size.z() * (double(p[2]) / cells[2] - 0.5)});
    return it->second;
  };
  for (size_t axis = 0; axis < 3; ++axis) {
    const size_t u = (axis + 1) % 3;
    const size_t v = (axis + 2) % 3;
    for (int side = 0; side < 2; ++side)
      for (int i = 0; i < cells[u]; ++i)
        for (int j = 0; j < cells[v]; ++j) {
          std::array<int, 4> quad{};
          const int du[4] = {0, 1, 1, 0};
          const int dv[4] = {0, 0, 1, 1};
          for (size_t c = 0; c < 4; ++c) {
            std::array<int, 3> p{};
            p[axis] = side * cells[axis];
            p[u] = i + du[c];
            p[v] = j + dv[c];
            quad[c] = vertex(p);
          }
          if (side == 0) std::swap(quad[1], quad[3]);
          surface.triangles.push_back({quad[0], quad[1], quad[2]});
          surface.triangles.push_back({quad[0], quad[2], quad[3]});
        }
  }
  return surface;
}

Surface sphereSurface(double radius, int levels) {
  requirePositive("sphere", "radius", radius);
  if (levels < 0 || levels > 9) throw InputError("sphere", "levels", "must be 0 to 9");
  Surface s;
  s.vertices = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  s.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<int, int>, int> middle;
    const auto mid = [&](int a, int b) {
      const auto [it, fresh] = middle.try_emplace(std::minmax(a, b), static_cast<int>(s.vertices.size()));
      if (fresh)
        s.vertices.push_back((s.vertices[static_cast<size_t>(a)] + s.vertices[static_cast<size_t>(b)]).normalized());
      return it->second;
    };
    std::vector<std::array<int, 3>> finer;
    for (const auto& t : s.triangles) {
      const int ab = mid(t[0], t[1]);
      const int bc = mid(t[1], t[2]);
      const int ca = mid(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}});
    }
    s.triangles = std::move(finer);
  }
  for (Vec3& x : s.vertices) x *= radius;
  return s;
}

Surface capsuleSurface(double radius, double length, int segments) {
  requirePositive("capsule", "radius", radius);
  requirePositive("capsule", "length", length);
  if (segments < 4 || segments > 4096 || segments % 4 != 0)
    throw InputError("capsule", "segments", "must be a multiple of 4, 4 to 4096");
  const int quarter = segments / 4;
  const double step = 2 * std::numbers::pi / segments;
  const int straight = std::clamp(static_cast<int>(std::lround(std::min(length / (radius * step), 4096.0))), 1, 4096);
  // Rings from the lower pole up: (height, radius).
  std::vector<std::pair<double, double>> rings;
  for (int i = 1; i <= quarter; ++i)
    rings.push_back({-length / 2 - radius * std::cos(i * step), radius * std::sin(i * step)});
  for (int i = 1; i <= straight; ++i) rings.push_back({-length / 2 + length * i / straight, radius});
  for (int i = quarter - 1; i >= 1; --i)
    rings.push_back({length / 2 + radius * std::cos(i * step), radius * std::sin(i * step)});
  Surface s;
  s.vertices.push_back({0, 0, -length / 2 - radius});
  for (const auto& [z, r] : rings)
    for (int i = 0; i < segments; ++i) s.vertices.push_back({r * std::cos(i * step), r * std::sin(i * step), z});
  s.vertices.push_back({0, 0, length / 2 + radius});
  const int top = static_cast<int>(s.vertices.size()) - 1;
  const int count = static_cast<int>(rings.size());
  const auto at = [&](int ring, int i) { return 1 + ring * segments + i % segments; };
  for (int i = 0; i < segments; ++i) {
    s.triangles.push_back({0, at(0, i + 1), at(0, i)});
    s.triangles.push_back({top, at(count - 1, i), at(count - 1, i + 1)});
    for (int r = 0; r + 1 < count; ++r) {
      s.triangles.push_back({at(r, i), at(r, i + 1), at(r + 1, i + 1)});
      s.triangles.push_back({at(r, i), at(r + 1, i + 1), at(r + 1, i)});
    }
  }
  return s;
}

}  // namespace palpate
