#pragma once

#include <algorithm>
#include <cmath>
#include <map>

#include "palpate/contact/collision_surface.h"

/// Two spheres of 10 cm that touch, of any number of triangles: what searches for contact are measured with.
namespace palpate::testing {

inline constexpr double kSphereRadius = 0.05;

/// Rings of triangles about z: 4 m (m + 1) of them, nearly alike in size except near the poles.
inline Surface ringSphere(int triangles) {
  const int rings = static_cast<int>(std::sqrt(triangles / 4.0)), around = 2 * rings;
  Surface s;
  s.vertices.emplace_back(0, 0, kSphereRadius);
  for (int i = 1; i <= rings; ++i)
    for (int j = 0; j < around; ++j) {
      const double polar = 3.14159265358979 * i / (rings + 1),
                   turn = 2 * 3.14159265358979 * (j + 0.5 * (i % 2)) / around;
      s.vertices.push_back(kSphereRadius *
                           Vec3(std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn), std::cos(polar)));
    }
  s.vertices.emplace_back(0, 0, -kSphereRadius);
  const auto at = [&](int ring, int j) { return 1 + ring * around + j % around; };
  const int last = static_cast<int>(s.vertices.size()) - 1;
  for (int j = 0; j < around; ++j) {
    s.triangles.push_back({0, at(0, j), at(0, j + 1)});
    s.triangles.push_back({last, at(rings - 1, j + 1), at(rings - 1, j)});
  }
  for (int i = 0; i + 1 < rings; ++i)
    for (int j = 0; j < around; ++j) {
      const int shift = i % 2;  // the ring below is half a step ahead, or behind
      s.triangles.push_back({at(i, j), at(i + 1, j + shift), at(i, j + 1)});
      s.triangles.push_back({at(i, j), at(i + 1, j + shift + around - 1), at(i + 1, j + shift)});
    }
  return s;
}

struct PressedSpheres {
  CollisionSurface left, right;
};

/// Side by side along x, where the triangles are even; the right one pressed flat against the left, so that about 2
/// cm^2 face each other at 0.3 mm, and moving by `motion`.
inline PressedSpheres pressedSpheres(int triangles, const Vec3& motion) {
  static std::map<int, CollisionSurface> made;
  if (!made.contains(triangles)) made.emplace(triangles, CollisionSurface(ringSphere(triangles)));
  PressedSpheres s{made.at(triangles), made.at(triangles)};
  const double flat = kSphereRadius - 6.6e-4;  // a cap of 2 cm^2 is cut off
  for (size_t i = 0; i < s.left.rest().size(); ++i) {
    Vec3 &l = s.left.start[i], &r = s.right.start[i];
    l.x() = std::min(l.x(), flat);
    r.x() = std::max(r.x(), -flat);
    r.x() += 2 * flat + 3e-4;
    s.left.end[i] = l;
    s.right.end[i] = r + motion;
  }
  s.left.refit();
  s.right.refit();
  return s;
}

}  // namespace palpate::testing
