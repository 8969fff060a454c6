#pragma once

// Collision surfaces moved at random, and their distances and meetings by brute force.

#include <random>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/feature_distance.h"
#include "palpate/mesh/shapes.h"

namespace palpate::test {

inline Eigen::Affine3d affine(const Eigen::Matrix3d& linear, const Vec3& offset) {
  Eigen::Affine3d t;
  t.linear() = linear;
  t.translation() = offset;
  return t;
}

/// Random numbers, rotations and closed surfaces of a few centimeters.
class Chance {
 public:
  explicit Chance(unsigned seed) : rng_(seed) {}
  double in(double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng_); }
  Vec3 vector(double size = 1) { return size * Vec3(in(-1, 1), in(-1, 1), in(-1, 1)); }
  Vec3 direction() {
    Vec3 d = vector();
    while (d.norm() < 0.1) d = vector();
    return d.normalized();
  }
  Mat3 rotation(double angle = 3.1) { return Eigen::AngleAxisd(in(-angle, angle), direction()).toRotationMatrix(); }
  Surface surface() {
    const int kind = std::uniform_int_distribution<int>(0, 2)(rng_);
    if (kind == 0) return sphereSurface(in(0.01, 0.03), 2);
    if (kind == 1) return boxSurface(Vec3(in(0.01, 0.05), in(0.01, 0.05), in(0.002, 0.05)), {3, 2, 2});
    return capsuleSurface(in(0.005, 0.02), in(0.01, 0.04), 8);
  }

 private:
  std::mt19937 rng_;
};

inline void place(CollisionSurface& s, const Eigen::Affine3d& start, const Eigen::Affine3d& end) {
  for (size_t i = 0; i < s.rest().size(); ++i) {
    s.start[i] = start * s.rest()[i];
    s.end[i] = end * s.rest()[i];
  }
  s.refit();
}

inline const Vec3& pointOf(const std::vector<Vec3>& x, int i) { return x[static_cast<size_t>(i)]; }

inline double vertexDistance(const Vec3& p, const CollisionSurface& s, const std::vector<Vec3>& x) {
  double best = 1e300;
  for (const auto& t : s.triangles())
    best = std::min(best, closestOnTriangle(p, pointOf(x, t[0]), pointOf(x, t[1]), pointOf(x, t[2])).distance);
  return best;
}

inline double edgeDistance(const std::array<int, 2>& e, const std::vector<Vec3>& xe, const CollisionSurface& s,
                           const std::vector<Vec3>& x) {
  double best = 1e300;
  for (const auto& f : s.edges())
    best = std::min(
        best, closestOnSegments(pointOf(xe, e[0]), pointOf(xe, e[1]), pointOf(x, f[0]), pointOf(x, f[1])).distance);
  return best;
}

/// Least distance of two surfaces that do not intersect, by every pair of features.
inline double bruteDistance(const CollisionSurface& a, const std::vector<Vec3>& xa, const CollisionSurface& b,
                            const std::vector<Vec3>& xb) {
  double best = 1e300;
  for (const Vec3& p : xa) best = std::min(best, vertexDistance(p, b, xb));
  for (const Vec3& p : xb) best = std::min(best, vertexDistance(p, a, xa));
  for (const auto& e : a.edges()) best = std::min(best, edgeDistance(e, xa, b, xb));
  return best;
}

/// 10 cm long, two cells wide, in the xy plane.
inline Surface strip(int cells) {
  Surface s;
  for (int i = 0; i <= cells; ++i)
    for (int j = 0; j <= 2; ++j) s.vertices.emplace_back(0.1 * i / cells, 0.003 * j + 1e-4 * i, 0);
  for (int i = 0; i < cells; ++i)
    for (int j = 0; j < 2; ++j) {
      const int v = 3 * i + j;
      s.triangles.push_back({v, v + 3, v + 4});
      s.triangles.push_back({v, v + 4, v + 1});
    }
  return s;
}

/// The strip curled up by an angle.
inline void bend(const CollisionSurface& s, std::vector<Vec3>& x, double angle) {
  const double radius = 0.1 / angle;
  for (size_t i = 0; i < x.size(); ++i) {
    const Vec3& p = s.rest()[i];
    x[i] = Vec3(radius * std::sin(p.x() / radius), p.y(), radius * (1 - std::cos(p.x() / radius)));
  }
}

}  // namespace palpate::test
