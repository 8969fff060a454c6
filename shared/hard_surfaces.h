#pragma once

// Surfaces that lattices have trouble with: thinner than a cell, tapering, ringed, touching, overlapping; and random
// ones.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "palpate/math/rotation.h"
#include "palpate/mesh/implicit_surface.h"
#include "palpate/mesh/shapes.h"

namespace palpate {

inline Surface turned(Surface s, const Vec3& rotation) {
  const Mat3 r = expRotation(rotation).toRotationMatrix();
  for (Vec3& x : s.vertices) x = r * x;
  return s;
}

inline void append(Surface& to, const Surface& from, const Vec3& shift) {
  const int base = static_cast<int>(to.vertices.size());
  for (const Vec3& x : from.vertices) to.vertices.push_back(x + shift);
  for (const auto& t : from.triangles) to.triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
}

/// A tail that winds up while it tapers from 10 mm to 2.5 mm.
inline Surface taperingTail() {
  const auto f = [](const Vec3& x) {
    double d = 1;
    Vec3 from(0.03, 0, 0);
    double thick = 0.01;
    for (int k = 1; k <= 24; ++k) {
      const double angle = 0.35 * k, r = 0.03 + 0.0015 * k;
      const Vec3 to(r * std::cos(angle), r * std::sin(angle), 0.003 * k);
      const double next = 0.01 - 0.0075 * k / 24;
      d = smoothUnion(d, taperedCapsuleDistance(x, from, to, thick, next), 0.002);
      from = to;
      thick = next;
    }
    return d;
  };
  return meshImplicit(f, {Vec3(-0.1, -0.1, -0.02), Vec3(0.1, 0.1, 0.1)}, 0.0016, 3);
}

/// Limbs from a trunk in random directions, of random length and thickness.
inline Surface randomLimbs(std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto share = [&] { return 0.5 * (uniform(random) + 1); };
  struct Limb {
    Vec3 from, to;
    double thick, thin;
  };
  std::vector<Limb> limbs = {{Vec3(0, 0, -0.03), Vec3(0, 0, 0.03), 0.015, 0.012}};
  const int count = 3 + static_cast<int>(5 * share());
  for (int k = 0; k < count; ++k) {
    Vec3 direction;  // one draw after another: compilers evaluate arguments in orders of their own
    for (const int axis : {2, 1, 0}) direction[axis] = uniform(random);
    direction.normalize();
    const Vec3 from(0, 0, 0.03 * uniform(random));
    limbs.push_back(
        {from, from + (0.04 + 0.05 * share()) * direction, 0.004 + 0.006 * share(), 0.0035 + 0.002 * share()});
  }
  const auto f = [&](const Vec3& x) {
    double d = 1;
    for (const Limb& l : limbs) d = smoothUnion(d, taperedCapsuleDistance(x, l.from, l.to, l.thick, l.thin), 0.006);
    return d;
  };
  return meshImplicit(f, {Vec3::Constant(-0.15), Vec3::Constant(0.15)}, 0.0024, 3);
}

/// Name and surface of each.
inline std::vector<std::pair<std::string, Surface>> hardSurfaces() {
  std::vector<std::pair<std::string, Surface>> out;
  out.emplace_back("plate of 1 mm", turned(boxSurface(Vec3(0.1, 0.08, 0.001), {10, 8, 1}), Vec3(0.3, 0.2, 0.1)));
  out.emplace_back("straight plate of 2 mm", boxSurface(Vec3(0.1, 0.1, 0.002)));
  out.emplace_back("needle", boxSurface(Vec3(0.1, 0.001, 0.001)));
  out.emplace_back("tail", taperingTail());
  for (std::uint32_t seed = 1; seed <= 4; ++seed) {
    out.emplace_back("limbs " + std::to_string(seed), randomLimbs(seed));
  }
  // three balls on a thread
  const auto f = [](const Vec3& x) {
    double d = taperedCapsuleDistance(x, Vec3(-0.08, 0, 0), Vec3(0.08, 0.02, 0.01), 0.003, 0.003);
    for (const double s : {-1.0, 0.0, 1.0}) d = smoothUnion(d, (x - s * Vec3(0.08, 0.02, 0.01)).norm() - 0.02, 0.004);
    return d;
  };
  out.emplace_back("beads on a thread", meshImplicit(f, {Vec3(-0.11, -0.05, -0.04), Vec3(0.11, 0.05, 0.04)}, 0.002, 3));
  return out;
}

}  // namespace palpate
