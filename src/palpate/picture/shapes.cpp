#include "palpate/picture/shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate {

PictureMesh latheMesh(const Vec3& origin, const Vec3& axis, const std::vector<std::array<double, 2>>& profile,
                      const Color& color) {
  constexpr int kSides = 40;
  PictureMesh mesh;
  mesh.colors = {color};
  const Vec3 u = axis.unitOrthogonal(), v = axis.cross(u);
  for (const auto& [along, radius] : profile) {
    for (int k = 0; k < kSides; ++k) {
      const double angle = 2.0 * std::numbers::pi * k / kSides;
      mesh.vertices.push_back(origin + along * axis + radius * (std::cos(angle) * u + std::sin(angle) * v));
    }
  }
  for (int i = 0; i + 1 < static_cast<int>(profile.size()); ++i) {
    for (int k = 0; k < kSides; ++k) {
      const int a = i * kSides + k, b = i * kSides + (k + 1) % kSides;
      if (profile[i][1] > 0.0) mesh.triangles.push_back({a, b, a + kSides});
      if (profile[i + 1][1] > 0.0) mesh.triangles.push_back({b, b + kSides, a + kSides});
    }
  }
  return mesh;
}

PictureMesh capsuleMesh(const Vec3& a, const Vec3& b, double radius, const Color& color) {
  constexpr int kRings = 10;  // of a half sphere
  const double length = (b - a).norm();
  const Vec3 axis = length > 0.0 ? Vec3((b - a) / length) : Vec3::UnitZ();
  std::vector<std::array<double, 2>> profile;
  for (int i = -kRings; i <= kRings; ++i) {
    const double angle = 0.5 * std::numbers::pi * i / kRings;
    const double around = std::abs(i) == kRings ? 0.0 : radius * std::cos(angle);
    profile.push_back({radius * std::sin(angle) + (i > 0 ? length : 0.0), around});
    if (i == 0 && length > 0.0) profile.push_back({length, radius});
  }
  return latheMesh(a, axis, profile, color);
}

PictureMesh boxMesh(const Pose& pose, const Vec3& half_extents, const Color& color) {
  PictureMesh mesh;
  mesh.colors = {color};
  const double cell = half_extents.maxCoeff() / 5.0;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const auto count = [&](int k) {
      return std::clamp(static_cast<int>(std::ceil(2.0 * half_extents[k] / cell)), 1, 10);
    };
    const int nu = count(u), nv = count(v);
    for (const int side : {-1, 1}) {
      const int first = static_cast<int>(mesh.vertices.size());
      for (int j = 0; j <= nv; ++j) {
        for (int i = 0; i <= nu; ++i) {
          Vec3 x;
          x[axis] = side * half_extents[axis];
          x[u] = half_extents[u] * (2.0 * i / nu - 1.0);
          x[v] = half_extents[v] * (2.0 * j / nv - 1.0);
          mesh.vertices.push_back(pose.apply(x));
        }
      }
      for (int j = 0; j < nv; ++j) {
        for (int i = 0; i < nu; ++i) {
          const int a = first + j * (nu + 1) + i, b = a + 1, c = a + nu + 1, d = c + 1;
          if (side > 0) {
            mesh.triangles.insert(mesh.triangles.end(), {{a, b, d}, {a, d, c}});
          } else {
            mesh.triangles.insert(mesh.triangles.end(), {{a, d, b}, {a, c, d}});
          }
        }
      }
    }
  }
  return mesh;
}

PictureMesh cutOpen(const PictureMesh& mesh, const Vec3& point, const Vec3& normal) {
  PictureMesh out = mesh;
  out.triangles.clear();
  const auto height = [&](int v) { return normal.dot(mesh.vertices[v] - point); };
  for (const auto& triangle : mesh.triangles) {
    std::array<int, 4> corners{};
    int count = 0;
    for (int k = 0; k < 3; ++k) {
      const int v = triangle[k], w = triangle[(k + 1) % 3];
      const double a = height(v), b = height(w);
      if (a >= 0.0) corners[count++] = v;
      if ((a >= 0.0) != (b >= 0.0)) {
        corners[count++] = static_cast<int>(out.vertices.size());
        out.vertices.emplace_back(mesh.vertices[v] + a / (a - b) * (mesh.vertices[w] - mesh.vertices[v]));
      }
    }
    for (int k = 2; k < count; ++k) out.triangles.push_back({corners[0], corners[k - 1], corners[k]});
  }
  return out;
}

PictureMesh arrowMesh(const Vec3& a, const Vec3& b, double width, const Color& color) {
  const double length = (b - a).norm();
  PictureMesh mesh;
  if (length > 0.0) {
    const double head = std::min(3.2 * width, 0.6 * length), r = 0.5 * width;
    const double shaft = length - head, flare = std::max(r, 0.42 * head);
    mesh = latheMesh(a, (b - a) / length, {{0, 0}, {0, r}, {shaft, r}, {shaft, flare}, {length, 0}}, color);
  }
  mesh.on_top = true;
  return mesh;
}

PictureMesh penMesh(const Vec3& tip, const Vec3& axis, double length, const Color& color) {
  const double r = 0.034 * length;
  PictureMesh mesh = latheMesh(tip, axis,
                               {{0, 0},
                                {0.01 * length, 0.3 * r},
                                {0.22 * length, 0.85 * r},
                                {0.34 * length, r},
                                {0.94 * length, r},
                                {0.985 * length, 0.75 * r},
                                {length, 0}},
                               color);
  mesh.gloss = 0.5F;
  return mesh;
}

}  // namespace palpate
