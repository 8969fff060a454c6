#include "palpate/picture/smooth_mesh.h"

#include <cmath>
#include <cstdint>
#include <unordered_map>

namespace palpate {

namespace {

using Vec3f = Eigen::Vector3f;

constexpr float kCosCrease = 0.766F;

float linearLight(float screen) {
  return screen <= 0.04045F ? screen / 12.92F : std::pow((screen + 0.055F) / 1.055F, 2.4F);
}

Vec3f unitOr(const Vec3f& v, const Vec3f& otherwise) {
  const float length = v.norm();
  return length > 0.0F ? Vec3f(v / length) : otherwise;
}

/// Triangles at each vertex, one list after the other.
struct Incidence {
  std::vector<int> first, triangle;
};

Incidence incidence(const PictureMesh& mesh) {
  Incidence out;
  out.first.assign(mesh.vertices.size() + 1, 0);
  for (const auto& t : mesh.triangles) {
    for (const int v : t) ++out.first[v + 1];
  }
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) out.first[v + 1] += out.first[v];
  out.triangle.resize(3 * mesh.triangles.size());
  std::vector<int> next(out.first.begin(), out.first.end() - 1);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const int v : mesh.triangles[t]) out.triangle[next[v]++] = static_cast<int>(t);
  }
  return out;
}

int cornerOf(const std::array<int, 3>& triangle, int vertex) {
  return triangle[0] == vertex ? 0 : triangle[1] == vertex ? 1 : 2;
}

}  // namespace

SmoothMesh smoothMesh(const PictureMesh& mesh, const Vec3& origin) {
  SmoothMesh out;
  out.triangles.resize(mesh.triangles.size());
  std::vector<Vec3f> positions, areas(mesh.triangles.size()), faces(mesh.triangles.size());
  for (const Vec3& x : mesh.vertices) positions.push_back((x - origin).cast<float>());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [a, b, c] = mesh.triangles[t];
    areas[t] = (positions[b] - positions[a]).cross(positions[c] - positions[a]);
    faces[t] = unitOr(areas[t], Vec3f::Zero());
  }
  const Incidence around = incidence(mesh);
  const auto add = [&](int vertex, const Vec3f& normal) {
    out.positions.push_back(positions[vertex]);
    out.normals.push_back(normal);
    const Color& color = mesh.colors.size() == mesh.vertices.size() ? mesh.colors[vertex] : mesh.colors.front();
    out.colors.push_back(color.unaryExpr(&linearLight));
    return static_cast<int>(out.positions.size()) - 1;
  };
  for (int v = 0; v < static_cast<int>(mesh.vertices.size()); ++v) {
    const int begin = around.first[v], end = around.first[v + 1];
    Vec3f mean = Vec3f::Zero();
    for (int i = begin; i < end; ++i) mean += areas[around.triangle[i]];
    mean = unitOr(mean, Vec3f::UnitZ());
    bool smooth = true;
    for (int i = begin; i < end; ++i) smooth = smooth && faces[around.triangle[i]].dot(mean) > kCosCrease;
    const int shared = smooth && begin < end ? add(v, mean) : -1;
    for (int i = begin; i < end; ++i) {
      const int t = around.triangle[i];
      int index = shared;
      if (!smooth) {
        Vec3f normal = Vec3f::Zero();
        for (int j = begin; j < end; ++j) {
          if (faces[around.triangle[j]].dot(faces[t]) > kCosCrease) normal += areas[around.triangle[j]];
        }
        index = add(v, unitOr(normal, mean));
      }
      out.triangles[t][cornerOf(mesh.triangles[t], v)] = index;
    }
  }
  return out;
}

void refine(SmoothMesh& mesh, double edge, std::size_t limit) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) sum += (mesh.positions[t[k]] - mesh.positions[t[(k + 1) % 3]]).norm();
  }
  double mean = mesh.triangles.empty() ? 0.0 : sum / (3.0 * static_cast<double>(mesh.triangles.size()));
  for (; mean > edge && 4 * mesh.triangles.size() <= limit; mean *= 0.5) {
    std::unordered_map<std::uint64_t, int> middles;
    const auto middle = [&](int a, int b) {
      if (a > b) std::swap(a, b);
      const auto key = (static_cast<std::uint64_t>(a) << 32U) | static_cast<std::uint32_t>(b);
      const auto [place, fresh] = middles.try_emplace(key, static_cast<int>(mesh.positions.size()));
      if (fresh) {
        // copies first: push_back() may move what its argument refers to
        const Vec3f position = 0.5F * (mesh.positions[a] + mesh.positions[b]);
        const Vec3f normal = unitOr(mesh.normals[a] + mesh.normals[b], mesh.normals[a]);
        const Vec3f color = 0.5F * (mesh.colors[a] + mesh.colors[b]);
        mesh.positions.push_back(position);
        mesh.normals.push_back(normal);
        mesh.colors.push_back(color);
      }
      return place->second;
    };
    std::vector<std::array<int, 3>> finer;
    finer.reserve(4 * mesh.triangles.size());
    for (const auto& [a, b, c] : mesh.triangles) {
      const int ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
}

}  // namespace palpate
