#include "palpate/mesh/mesh_quality.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/mesh/edge_table.h"
#include "palpate/mesh/face_table.h"

namespace palpate {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

double angleBetween(const Vec3& a, const Vec3& b) { return kDegrees * std::atan2(a.cross(b).norm(), a.dot(b)); }

int faceComponents(const TetrahedralMesh& mesh) {
  const std::vector<FaceUse> faces = faceTable(mesh.tetrahedra);
  DisjointSets sets(static_cast<int>(mesh.tetrahedra.size()));
  for (size_t i = 1; i < faces.size(); ++i)
    if (faces[i].first == faces[i - 1].first) sets.unite(faces[i].second, faces[i - 1].second);
  int count = 0;
  for (int i = 0; i < static_cast<int>(mesh.tetrahedra.size()); ++i) count += sets.find(i) == i;
  return count;
}

}  // namespace

double tetrahedronVolume(const TetrahedralMesh& mesh, const std::array<int, 4>& t) {
  const Vec3& x0 = mesh.nodes[static_cast<size_t>(t[0])];
  return (mesh.nodes[static_cast<size_t>(t[1])] - x0)
             .cross(mesh.nodes[static_cast<size_t>(t[2])] - x0)
             .dot(mesh.nodes[static_cast<size_t>(t[3])] - x0) /
         6;
}

std::vector<double> resistingShares(const SimulationMesh& mesh) {
  constexpr double kLeast = 0.2;
  std::vector<double> fullest(mesh.mesh.nodes.size(), 0);
  for (size_t t = 0; t < mesh.fill.size(); ++t) {
    for (int n : mesh.mesh.tetrahedra[t]) {
      double& at = fullest[static_cast<size_t>(n)];
      at = std::max(at, mesh.fill[t]);
    }
  }
  std::vector<double> shares = mesh.fill;
  for (size_t t = 0; t < shares.size(); ++t)
    for (int n : mesh.mesh.tetrahedra[t]) shares[t] = std::max(shares[t], kLeast * fullest[static_cast<size_t>(n)]);
  return shares;
}

bool isTurnedOver(const std::array<int, 4>& t, const VecX& positions) {
  const auto at = [&](size_t k) { return positions.segment<3>(3 * t[k]); };
  const Vec3 u = at(1) - at(0), v = at(2) - at(0), w = at(3) - at(0);
  return !(u.cross(v).dot(w) > 0);
}

TetrahedraQuality measureQuality(const TetrahedralMesh& mesh) {
  TetrahedraQuality q;
  if (mesh.tetrahedra.empty()) return q;
  q.smallest_dihedral_deg = 180;
  q.worst_radius_ratio = 1;
  q.smallest_volume = std::abs(tetrahedronVolume(mesh, mesh.tetrahedra[0]));
  DisjointSets pieces(static_cast<int>(mesh.nodes.size()));
  std::vector<char> used(mesh.nodes.size(), 0);
  for (const auto& t : mesh.tetrahedra) {
    std::array<Vec3, 4> x;
    for (size_t k = 0; k < 4; ++k) x[k] = mesh.nodes[static_cast<size_t>(t[k])];
    const double volume = std::abs(tetrahedronVolume(mesh, t));
    q.smallest_volume = std::min(q.smallest_volume, volume);
    double area = 0;
    for (size_t a = 0; a < 4; ++a) {
      pieces.unite(t[0], t[a]);
      used[static_cast<size_t>(t[a])] = 1;
      for (size_t b = a + 1; b < 4; ++b) {
        // Dihedral angle at edge ab: between the other two corners as seen along the edge.
        size_t c = 0;
        while (c == a || c == b) ++c;
        const size_t d = 6 - a - b - c;
        const Vec3 edge = (x[b] - x[a]).normalized();
        const Vec3 toward_c = (x[c] - x[a]) - edge.dot(x[c] - x[a]) * edge;
        const Vec3 toward_d = (x[d] - x[a]) - edge.dot(x[d] - x[a]) * edge;
        const double angle = angleBetween(toward_c, toward_d);
        q.smallest_dihedral_deg = std::min(q.smallest_dihedral_deg, angle);
        q.largest_dihedral_deg = std::max(q.largest_dihedral_deg, angle);
      }
      area += 0.5 * (x[(a + 2) % 4] - x[(a + 1) % 4]).cross(x[(a + 3) % 4] - x[(a + 1) % 4]).norm();
    }
    // Circumradius from the products of opposite edges (Crelle's formula).
    const double p = (x[1] - x[0]).norm() * (x[3] - x[2]).norm();
    const double r = (x[2] - x[0]).norm() * (x[3] - x[1]).norm();
    const double s = (x[3] - x[0]).norm() * (x[2] - x[1]).norm();
    const double crelle = (p + r + s) * (p + r - s) * (p - r + s) * (-p + r + s);
    const double circumradius = volume > 0 ? std::sqrt(std::max(crelle, 0.0)) / (24 * volume) : 0;
    const double inradius = area > 0 ? 3 * volume / area : 0;
    q.worst_radius_ratio = std::min(q.worst_radius_ratio, circumradius > 0 ? 3 * inradius / circumradius : 0);
  }
  for (size_t v = 0; v < used.size(); ++v)
    q.components += used[v] && pieces.find(static_cast<int>(v)) == static_cast<int>(v);
  q.face_components = faceComponents(mesh);
  return q;
}

TriangleQuality measureQuality(const Surface& surface) {
  TriangleQuality q;
  if (surface.triangles.empty()) return q;
  q.smallest_angle_deg = 180;
  q.shortest_edge = INFINITY;
  for (const auto& t : surface.triangles) {
    for (size_t k = 0; k < 3; ++k) {
      const Vec3& a = surface.vertices[static_cast<size_t>(t[k])];
      const Vec3& b = surface.vertices[static_cast<size_t>(t[(k + 1) % 3])];
      const Vec3& c = surface.vertices[static_cast<size_t>(t[(k + 2) % 3])];
      const double angle = angleBetween(b - a, c - a);
      q.smallest_angle_deg = std::min(q.smallest_angle_deg, angle);
      q.largest_angle_deg = std::max(q.largest_angle_deg, angle);
      q.shortest_edge = std::min(q.shortest_edge, (b - a).norm());
      q.longest_edge = std::max(q.longest_edge, (b - a).norm());
    }
  }
  return q;
}

}  // namespace palpate
