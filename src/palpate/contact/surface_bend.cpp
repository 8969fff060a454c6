#include "palpate/contact/surface_bend.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr double kReach = 0.005;         // [m]: as far as contacts are looked for
constexpr double kAlike = 0.82;          // cosine of normals that belong together; a chamfer is an edge
constexpr double kRoundedStep = 1e-6;    // steps of the normal that are rounding
constexpr double kLeastShare = 0.1;      // of the disk's whole weight: less of it says nothing
constexpr std::size_t kMostFaces = 128;  // triangles that are looked at, the nearest first: bounds the time

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

// Part of a segment that lies in the disk of this radius about the origin: from and to, as shares of it; empty where
// from >= to.
std::array<double, 2> inDisk(const Vec2& p, const Vec2& q, double radius) {
  const Vec2 d = q - p;
  const double a = d.squaredNorm(), b = p.dot(d), c = p.squaredNorm() - radius * radius;
  const double root = b * b - a * c;
  if (!(a > 0) || root <= 0) return {0, 0};
  const double s = std::sqrt(root);
  return {std::max(0.0, (-b - s) / a), std::min(1.0, (-b + s) / a)};
}

// What counts at a distance s from the middle is 1 - s^2 / radius^2, so that nothing jumps where an edge comes in. Of a
// segment in the disk, the integral [m].
double weightOf(const Vec2& p, const Vec2& q, double radius) {
  const double mean = (p.squaredNorm() + p.dot(q) + q.squaredNorm()) / 3;
  return (q - p).norm() * (1 - mean / (radius * radius));
}

// The same of the area, with its sign, between the origin and a segment, as far as it is in the disk [m^2].
double weightBefore(const Vec2& p, const Vec2& q, double radius) {
  const auto arc = [&](const Vec2& u, const Vec2& v) {
    return 0.25 * radius * radius * std::atan2(cross(u, v), u.dot(v));
  };
  const auto [from, to] = inDisk(p, q, radius);
  if (from >= to) return arc(p, q);
  const Vec2 u = p + from * (q - p), v = p + to * (q - p);
  const double mean = (u.squaredNorm() + u.dot(v) + v.squaredNorm()) / 6;
  // an end in the disk has no arc: at the origin rounding would make one of any angle
  const double arcs = (from > 0 ? arc(p, u) : 0.0) + (to < 1 ? arc(v, q) : 0.0);
  return arcs + 0.5 * cross(u, v) * (1 - mean / (radius * radius));
}

struct FaceInPlane {
  int triangle;
  Vec3 normal;
  std::array<Vec2, 3> corner;  // in the tangent plane
};

}  // namespace

Mat3 surfaceBend(const CollisionSurface& surface, std::span<const int> triangles, const Vec3& place,
                 const Vec3& normal) {
  const Vec3 first = normal.unitOrthogonal(), second = normal.cross(first);
  const auto faceOf = [&](int t) {
    FaceInPlane face{t, Vec3::Zero(), {}};
    const std::array<Vec3, 3> x = surface.startCorners(t);
    for (std::size_t k = 0; k < 3; ++k) {
      face.corner[k] = Vec2(first.dot(x[k] - place), second.dot(x[k] - place));
    }
    face.normal = (x[1] - x[0]).cross(x[2] - x[0]).normalized();
    return face;
  };
  std::vector<FaceInPlane> faces;
  const auto find = [&](int t) {
    return std::find_if(faces.begin(), faces.end(), [&](const FaceInPlane& f) { return f.triangle == t; });
  };
  const auto add = [&](int t, const Vec3& beside) {
    if (find(t) != faces.end()) return;
    const FaceInPlane face = faceOf(t);
    if (face.normal.dot(normal) > kAlike && face.normal.dot(beside) > kAlike) faces.push_back(face);
  };
  // at a crease, only the side that faces as the contact does
  Vec3 facing = Vec3::Zero();
  for (const int t : triangles) {
    const Vec3 n = faceOf(t).normal;
    if (n.dot(normal) > facing.dot(normal)) facing = n;
  }
  for (const int t : triangles) add(t, facing);
  double area = 0;
  Mat3 sum = Mat3::Zero();
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const FaceInPlane face = faces[i];
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec2 &p = face.corner[k], &q = face.corner[(k + 1) % 3];
      area += weightBefore(p, q, kReach);
      const auto [from, to] = inDisk(p, q, kReach);
      if (from >= to) continue;
      const int e = surface.triangleEdges()[static_cast<std::size_t>(face.triangle)][k];
      const auto& [t, u] = surface.edgeTriangles()[static_cast<std::size_t>(e)];
      const int other = t == face.triangle ? u : t;
      if (other < 0) continue;
      if (faces.size() < kMostFaces) add(other, face.normal);
      const auto found = find(other);
      if (found == faces.end() || !(found->normal.dot(face.normal) > kAlike)) continue;
      // each edge comes twice, once from either side: half of the step across it, outward from this triangle
      const Vec2 along = (q - p).normalized();
      const double weight = weightOf(p + from * (q - p), p + to * (q - p), kReach);
      const Vec3 out = weight * (along.y() * first - along.x() * second);
      const Vec3 step = found->normal - face.normal;
      if (step.squaredNorm() < kRoundedStep * kRoundedStep) continue;
      sum += 0.5 * (step - normal.dot(step) * normal) * out.transpose();
    }
  }
  if (!(area > kLeastShare * 0.5 * std::numbers::pi * kReach * kReach)) return Mat3::Zero();
  return (0.5 / area) * (sum + sum.transpose());
}

}  // namespace palpate
