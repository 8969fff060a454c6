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

namespace {

/// Of a solid, about a center of its own.
struct Integrals {
  double volume = 0;
  Vec3 first = Vec3::Zero();   ///< of x
  Mat3 second = Mat3::Zero();  ///< of x x^T
};

Integrals integralsOf(const Surface& surface, const Vec3& center) {
  Integrals sum;
  for (const auto& t : surface.triangles) {
    const Vec3 a = surface.vertices[static_cast<size_t>(t[0])] - center;
    const Vec3 b = surface.vertices[static_cast<size_t>(t[1])] - center;
    const Vec3 c = surface.vertices[static_cast<size_t>(t[2])] - center;
    const double det = a.dot(b.cross(c));
    const Vec3 corners = a + b + c;
    sum.volume += det / 6;
    sum.first += det / 24 * corners;
    sum.second +=
        det / 120 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + corners * corners.transpose());
  }
  return sum;
}

double fullArea(const Surface& surface) {
  double area = 0;
  for (const auto& t : surface.triangles) {
    const Vec3& a = surface.vertices[static_cast<size_t>(t[0])];
    const Vec3& b = surface.vertices[static_cast<size_t>(t[1])];
    const Vec3& c = surface.vertices[static_cast<size_t>(t[2])];
    area += 0.5 * (b - a).cross(c - a).norm();
  }
  return area;
}

SurfaceMeasures measuresOf(const Integrals& sum, double area, const Vec3& center) {
  SurfaceMeasures m;
  m.area = area;
  m.volume = sum.volume;
  m.center_of_mass = center;
  if (m.volume == 0) return m;
  const Vec3 mean = sum.first / m.volume;
  const Mat3 covariance = sum.second - m.volume * mean * mean.transpose();
  m.center_of_mass = center + mean;
  m.inertia = covariance.trace() * Mat3::Identity() - covariance;
  return m;
}

/// Lines along x through the middles of a grid's cells, and where they pass a surface without boundary. Along each the
/// winding number is known, so what a surface counts more than once, or wrongly as less than nothing, is integrated.
class LineGrid {
 public:
  LineGrid(const Surface& surface, const Vec3& center) : surface_(surface) {
    // Askew, as many solids have faces along the axes: those would lie within cells all at the same place.
    points_.reserve(surface.vertices.size());
    for (const Vec3& x : surface.vertices) points_.push_back(turn_ * (x - center));
    const Bounds box = boundsOf(points_);
    low_ = box.low;
    const Vec3 size = (box.high - box.low).cwiseMax(1e-12 * box.diagonal());
    double layers = 0;
    for (const auto& t : surface.triangles) {
      const Bounds around = boundsOf({point(t[0]), point(t[1]), point(t[2])});
      const Vec3 share = (around.high - around.low).cwiseQuotient(size);
      layers += share.y() * share.z();
    }
    // Triangles that lie many over another take no more time than others.
    side_ = static_cast<int>(std::clamp(std::sqrt(kMostTests / std::max(layers, 1.0)), 16.0, 512.0));
    cell_ = size / side_;
  }

  /// Integral of the winding number less 1 where that is inside, about the center along the surface's axes.
  Integrals excess() {
    for (const auto& t : surface_.triangles) cross(t);
    std::sort(crossings_.begin(), crossings_.end(), [](const Crossing& a, const Crossing& b) {
      return std::tie(a.line, a.x, a.step) < std::tie(b.line, b.x, b.step);
    });
    Integrals sum;
    for (size_t i = 0, end = 0; i < crossings_.size(); i = end) {
      int winding = 0;
      for (end = i; end < crossings_.size() && crossings_[end].line == crossings_[i].line; ++end)
        winding += crossings_[end].step;
      if (winding != 0) continue;  // by rounding, right at a corner
      for (size_t k = i; k + 1 < end; ++k) {
        winding += crossings_[k].step;
        const int more = winding - (winding > 0 ? 1 : 0);
        if (more != 0) add(more, crossings_[k], crossings_[k + 1].x, sum);
      }
    }
    sum.first = turn_.transpose() * sum.first;
    sum.second = turn_.transpose() * sum.second * turn_;
    return sum;
  }

 private:
  static constexpr double kMostTests = 2e7;  // whether a line passes a triangle
  struct Crossing {
    int line;
    int step;  ///< of the winding number towards larger x
    double x;
  };

  const Vec3& point(int vertex) const { return points_[static_cast<size_t>(vertex)]; }

  /// Whether a line passes left of the edge from a to b, seen against x: computed from the same end for either triangle
  /// at an edge, so that a line passes exactly one of them.
  bool isLeft(int a, int b, double y, double z) const {
    const Vec3& p = point(std::min(a, b));
    const Vec3& q = point(std::max(a, b));
    return ((q.y() - p.y()) * (z - p.z()) - (q.z() - p.z()) * (y - p.y()) >= 0) == (a < b);
  }

  void cross(const std::array<int, 3>& t) {
    const Vec3& a = point(t[0]);
    const Vec3& b = point(t[1]);
    const Vec3& c = point(t[2]);
    const Vec3 normal = (b - a).cross(c - a);
    if (normal.x() == 0) return;
    std::array<int, 3> from{}, to{};
    for (const int d : {1, 2}) {
      const auto s = static_cast<size_t>(d);
      from[s] = std::max(0, static_cast<int>((std::min({a[d], b[d], c[d]}) - low_[d]) / cell_[d] - 0.5));
      to[s] = std::min(side_ - 1, static_cast<int>((std::max({a[d], b[d], c[d]}) - low_[d]) / cell_[d] + 0.5));
    }
    for (int j = from[1]; j <= to[1]; ++j)
      for (int k = from[2]; k <= to[2]; ++k) {
        const double y = low_.y() + (j + 0.5) * cell_.y(), z = low_.z() + (k + 0.5) * cell_.z();
        const bool left = isLeft(t[0], t[1], y, z);
        if (isLeft(t[1], t[2], y, z) != left || isLeft(t[2], t[0], y, z) != left) continue;
        const double x = a.x() - (normal.y() * (y - a.y()) + normal.z() * (z - a.z())) / normal.x();
        // A normal against x is where the line enters.
        crossings_.push_back({j * side_ + k, left ? -1 : 1,
                              std::clamp(x, std::min({a.x(), b.x(), c.x()}), std::max({a.x(), b.x(), c.x()}))});
      }
  }

  void add(int times, const Crossing& begin, double end, Integrals& sum) const {
    const double y = low_.y() + (begin.line / side_ + 0.5) * cell_.y();
    const double z = low_.z() + (begin.line % side_ + 0.5) * cell_.z();
    const double volume = times * (end - begin.x) * cell_.y() * cell_.z();
    const Vec3 middle(0.5 * (begin.x + end), y, z);
    sum.volume += volume;
    sum.first += volume * middle;
    sum.second += volume * middle * middle.transpose();
    sum.second(0, 0) += volume * (end - begin.x) * (end - begin.x) / 12;
  }

  const Mat3 turn_ = Quat(0.83, 0.31, -0.22, 0.41).normalized().toRotationMatrix();
  const Surface& surface_;
  std::vector<Vec3> points_;  ///< the surface's vertices, turned
  Vec3 low_, cell_;
  int side_;  ///< cells
  std::vector<Crossing> crossings_;
};

}  // namespace

SurfaceMeasures measureSurface(const Surface& surface) {
  // Relative to the box's center, so that a surface far from the origin loses no digits.
  const Vec3 center = boundsOf(surface.vertices).center();
  return measuresOf(integralsOf(surface, center), fullArea(surface), center);
}

SurfaceMeasures measureSolid(const Surface& surface) {
  constexpr double kOverlap = 2e-3;  // of the volume: as for soft bodies, whose mesh sees no less
  const Surface capped = capHoles(surface);
  const Vec3 center = boundsOf(capped.vertices).center();
  Integrals sum = integralsOf(capped, center);
  const bool sound =
      std::all_of(capped.vertices.begin(), capped.vertices.end(), [](const Vec3& x) { return x.allFinite(); });
  if (sound && sum.volume > 0) {
    const Integrals excess = LineGrid(capped, center).excess();
    if (excess.volume > kOverlap * (sum.volume - excess.volume)) {
      sum.volume -= excess.volume;
      sum.first -= excess.first;
      sum.second -= excess.second;
    }
  }
  return measuresOf(sum, fullArea(capped), center);
}

MassProperties surfaceMassProperties(const Surface& surface, double density, const std::string& name) {
  if (!(density > 0) || !std::isfinite(density)) throw InputError(name, "density", "must be positive and finite");
  const SurfaceMeasures solid = measureSolid(surface);
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
