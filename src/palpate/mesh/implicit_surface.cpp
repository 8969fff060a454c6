#include "palpate/mesh/implicit_surface.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "palpate/common/error.h"

namespace palpate {

double sphereDistance(const Vec3& x, const Vec3& center, double radius) { return (x - center).norm() - radius; }

double ellipsoidDistance(const Vec3& x, const Vec3& center, const Vec3& radii) {
  const Vec3 p = x - center;
  const double k0 = p.cwiseQuotient(radii).norm();
  const double k1 = p.cwiseQuotient(radii.cwiseProduct(radii)).norm();
  return k1 > 0 ? k0 * (k0 - 1) / k1 : -radii.minCoeff();
}

double taperedCapsuleDistance(const Vec3& x, const Vec3& a, const Vec3& b, double radius_a, double radius_b) {
  const Vec3 axis = b - a;
  const double s = std::clamp((x - a).dot(axis) / axis.squaredNorm(), 0.0, 1.0);
  return (x - a - s * axis).norm() - (radius_a + s * (radius_b - radius_a));
}

double smoothUnion(double a, double b, double blend) {
  if (blend <= 0) return std::min(a, b);
  const double h = std::max(blend - std::abs(a - b), 0.0) / blend;
  return std::min(a, b) - 0.25 * h * h * blend;
}

double smoothIntersection(double a, double b, double blend) { return -smoothUnion(-a, -b, blend); }

namespace {

class SurfaceNets {
 public:
  SurfaceNets(const ImplicitFunction& f, const Bounds& box, double cell) : f_(f), box_(box), cell_(cell) {
    for (int d = 0; d < 3; ++d) {
      count_[d] = static_cast<int>(std::ceil((box.high[d] - box.low[d]) / cell)) + 1;
      if (count_[d] < 2 || count_[d] > 1024)
        throw std::invalid_argument("meshImplicit: grid of 2 to 1024 points a side");
    }
  }

  Surface build() {
    sample();
    placeVertices();
    for (int axis = 0; axis < 3; ++axis) makeQuads(axis);
    return std::move(surface_);
  }

 private:
  size_t index(int i, int j, int k) const {
    return (static_cast<size_t>(k) * static_cast<size_t>(count_[1]) + static_cast<size_t>(j)) *
               static_cast<size_t>(count_[0]) +
           static_cast<size_t>(i);
  }
  Vec3 gridPoint(int i, int j, int k) const { return box_.low + cell_ * Vec3(i, j, k); }

  void sample() {
    values_.resize(index(count_[0] - 1, count_[1] - 1, count_[2] - 1) + 1);
    for (int k = 0; k < count_[2]; ++k)
      for (int j = 0; j < count_[1]; ++j)
        for (int i = 0; i < count_[0]; ++i) values_[index(i, j, k)] = f_(gridPoint(i, j, k));
  }

  void placeVertices() {
    vertex_of_.assign(values_.size(), -1);
    for (int k = 0; k + 1 < count_[2]; ++k)
      for (int j = 0; j + 1 < count_[1]; ++j)
        for (int i = 0; i + 1 < count_[0]; ++i) placeVertex(i, j, k);
  }

  // Mean of the crossings on the cell's twelve edges.
  void placeVertex(int i, int j, int k) {
    Vec3 sum = Vec3::Zero();
    int crossings = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const std::array<int, 3> c = {corner & 1, (corner >> 1) & 1, corner >> 2};
      for (size_t axis = 0; axis < 3; ++axis) {
        if (c[axis] == 1) continue;
        std::array<int, 3> e = c;
        e[axis] = 1;
        const double a = values_[index(i + c[0], j + c[1], k + c[2])];
        const double b = values_[index(i + e[0], j + e[1], k + e[2])];
        if ((a < 0) == (b < 0)) continue;
        const double s = a / (a - b);
        sum += (1 - s) * gridPoint(i + c[0], j + c[1], k + c[2]) + s * gridPoint(i + e[0], j + e[1], k + e[2]);
        ++crossings;
      }
    }
    if (crossings == 0) return;
    vertex_of_[index(i, j, k)] = static_cast<int>(surface_.vertices.size());
    surface_.vertices.push_back(sum / crossings);
  }

  void makeQuads(int axis) {
    const int u = (axis + 1) % 3;
    const int v = (axis + 2) % 3;
    std::array<int, 3> p{};
    const auto a = static_cast<size_t>(axis);
    const auto iu = static_cast<size_t>(u);
    const auto iv = static_cast<size_t>(v);
    for (p[2] = 0; p[2] < count_[2]; ++p[2])
      for (p[1] = 0; p[1] < count_[1]; ++p[1])
        for (p[0] = 0; p[0] < count_[0]; ++p[0]) {
          if (p[a] + 1 >= count_[axis] || p[iu] == 0 || p[iv] == 0) continue;
          if (p[iu] + 1 >= count_[u] || p[iv] + 1 >= count_[v]) continue;
          std::array<int, 3> q = p;
          ++q[a];
          const bool from = values_[index(p[0], p[1], p[2])] < 0;
          const bool to = values_[index(q[0], q[1], q[2])] < 0;
          if (from != to) addQuad(p, iu, iv, from);
        }
  }

  void addQuad(const std::array<int, 3>& p, size_t u, size_t v, bool outward_along_axis) {
    std::array<int, 4> corner{};
    const int du[4] = {-1, 0, 0, -1};
    const int dv[4] = {-1, -1, 0, 0};
    for (size_t c = 0; c < 4; ++c) {
      std::array<int, 3> q = p;
      q[u] += du[c];
      q[v] += dv[c];
      corner[c] = vertex_of_[index(q[0], q[1], q[2])];
    }
    if (!outward_along_axis) std::swap(corner[1], corner[3]);
    const auto point = [&](size_t c) -> const Vec3& { return surface_.vertices[static_cast<size_t>(corner[c])]; };
    if ((point(0) - point(2)).squaredNorm() <= (point(1) - point(3)).squaredNorm()) {
      surface_.triangles.push_back({corner[0], corner[1], corner[2]});
      surface_.triangles.push_back({corner[0], corner[2], corner[3]});
    } else {
      surface_.triangles.push_back({corner[0], corner[1], corner[3]});
      surface_.triangles.push_back({corner[1], corner[2], corner[3]});
    }
  }

  const ImplicitFunction& f_;
  Bounds box_;
  double cell_;
  Eigen::Vector3i count_ = Eigen::Vector3i::Zero();
  std::vector<double> values_;
  std::vector<int> vertex_of_;
  Surface surface_;
};

Vec3 gradient(const ImplicitFunction& f, const Vec3& x, double step) {
  Vec3 g;
  for (int d = 0; d < 3; ++d) {
    const Vec3 e = step * Vec3::Unit(d);
    g[d] = (f(x + e) - f(x - e)) / (2 * step);
  }
  return g;
}

Vec3 project(const ImplicitFunction& f, Vec3 x, double cell) {
  for (int i = 0; i < 3; ++i) {
    const Vec3 g = gradient(f, x, 1e-3 * cell);
    const double g2 = g.squaredNorm();
    if (g2 < 1e-12) break;
    Vec3 move = -f(x) / g2 * g;
    const double length = move.norm();
    if (length > 0.5 * cell) move *= 0.5 * cell / length;
    x += move;
  }
  return x;
}

void relax(const ImplicitFunction& f, Surface& surface, double cell, int rounds) {
  std::vector<Vec3> sum(surface.vertices.size());
  std::vector<double> weight(surface.vertices.size());
  for (int round = 0; round < rounds; ++round) {
    std::fill(sum.begin(), sum.end(), Vec3::Zero());
    std::fill(weight.begin(), weight.end(), 0.0);
    // Towards the area-weighted mean of the triangles' centers, which evens out sizes as well as shapes.
    for (const auto& t : surface.triangles) {
      const Vec3& a = surface.vertices[static_cast<size_t>(t[0])];
      const Vec3& b = surface.vertices[static_cast<size_t>(t[1])];
      const Vec3& c = surface.vertices[static_cast<size_t>(t[2])];
      const double area = (b - a).cross(c - a).norm();
      for (int v : t) {
        sum[static_cast<size_t>(v)] += area / 3 * (a + b + c);
        weight[static_cast<size_t>(v)] += area;
      }
    }
    for (size_t v = 0; v < sum.size(); ++v) {
      Vec3& x = surface.vertices[v];
      const Vec3 n = gradient(f, x, 1e-3 * cell).normalized();
      Vec3 move = weight[v] > 0 ? Vec3(sum[v] / weight[v] - x) : Vec3::Zero();
      move -= n.dot(move) * n;
      x = project(f, x + 0.7 * move, cell);
    }
  }
}

}  // namespace

Surface meshImplicit(const ImplicitFunction& f, const Bounds& box, double cell, int rounds) {
  // A grid cell that two sheets of the surface cross gives them one vertex, which is not manifold. It takes bad luck
  // with a crease about as thin as a cell; another grid avoids it.
  for (int attempt = 0; attempt < 10; ++attempt) {
    const double size = cell * (1 - 0.013 * attempt);
    Surface surface = SurfaceNets(f, box, size).build();
    if (surface.triangles.empty()) throw RunError("meshImplicit: no zero set in the box");
    if (!inspectTopology(surface).closed()) continue;
    relax(f, surface, size, rounds);
    return surface;
  }
  throw RunError("meshImplicit: details are too fine for this grid size, or the surface leaves the box");
}

}  // namespace palpate
