#pragma once

// Boxes and balls, soft or rigid, anywhere in space, and what happens between them: crossings, impulses, power.

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/overlap.h"
#include "shared/held_scenes.h"

namespace palpate::test {

enum class Kind { soft, rigid };

inline Pose at(const Vec3& position) { return {position, Quat::Identity()}; }

inline Vec6 moving(const Vec3& velocity, const Vec3& spin = Vec3::Zero()) {
  Vec6 twist;
  twist << velocity, spin;
  return twist;
}

inline Surface placed(Surface surface, const Pose& pose) {
  for (Vec3& p : surface.vertices) p = pose.apply(p);
  return surface;
}

/// Box [-size/2, size/2] at a pose, soft or rigid, without drag against the world.
struct BoxOptions {
  std::array<int, 3> cells{2, 2, 2};
  double youngs_modulus = 5e4;  // [Pa]
  double density = 1000;        // [kg/m^3]
  double damping_beta = 0.01;   // [s]
  double friction = 0.5;
};
inline BodyModel box(Kind kind, const std::string& name, const Vec3& size, const Pose& pose,
                     const BoxOptions& options = {}, const Vec6& twist = Vec6::Zero()) {
  if (kind == Kind::rigid) {
    return BodyModel::rigid(name, placed(boxSurface(size, options.cells), pose), options.density, options.friction,
                            twist);
  }
  Material material;
  material.youngs_modulus = options.youngs_modulus;
  material.density = options.density;
  material.damping_beta = options.damping_beta;
  const SimulationMesh centered = moved(barMesh(size, options.cells), at(-0.5 * size));
  return BodyModel(name, moved(centered, pose), material, options.friction, twist);
}

/// Soft ball: a cube's grid blown up, so all nodes of its sides lie on the sphere.
inline SimulationMesh ballMesh(double radius, const Vec3& center, int cells = 4) {
  TetrahedralMesh mesh = moved(barMesh(Vec3(2, 2, 2), {cells, cells, cells}), at(Vec3(-1, -1, -1))).mesh;
  for (Vec3& p : mesh.nodes) {
    if (p.norm() > 0) p *= p.cwiseAbs().maxCoeff() / p.norm();
    p = center + radius * p;
  }
  return simulationMeshOf(std::move(mesh), "ball");
}

/// Surface vertices at the given node positions.
inline std::vector<Vec3> surfacePoints(const Body& body, const VecX& x) {
  std::vector<Vec3> out;
  for (const EmbeddedPoint& e : body.model.mesh().embedding) {
    Vec3 p = Vec3::Zero();
    for (int k = 0; k < 4; ++k)
      p += e.weights[k] * x.segment<3>(3 * body.model.mesh().mesh.tetrahedra[e.tetrahedron][k]);
    out.push_back(p);
  }
  return out;
}
inline std::vector<Vec3> surfacePoints(const Body& body) { return surfacePoints(body, body.state.positions); }

/// Least and greatest coordinate of the surface.
inline std::pair<double, double> extent(const Body& body, int axis) {
  double low = 1e300;
  double high = -1e300;
  for (const Vec3& p : surfacePoints(body)) {
    low = std::min(low, p[axis]);
    high = std::max(high, p[axis]);
  }
  return {low, high};
}

inline bool overlap(const Body& a, const Body& b) {
  const auto surface = [](const Body& body) {
    CollisionSurface s(body.model.mesh().surface);
    s.start = s.end = surfacePoints(body);
    s.refit();
    return s;
  };
  std::vector<OverlapPoint> points;
  findOverlaps(surface(a), surface(b), points);
  return !points.empty();
}

/// Greatest speed of a node [m/s].
inline double fastest(const Body& body) {
  double speed = 0;
  for (int i = 0; i < body.model.nodes(); ++i) speed = std::max(speed, body.state.velocities.segment<3>(3 * i).norm());
  return speed;
}

/// Impulse of a contact on its first point, world frame [N s].
inline Vec3 impulseOf(const ContactSet& set, std::size_t i) {
  return set.contacts[i].frame().transpose() * set.impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
}

/// What an impulse gives a body by way of the weights of its nodes, at the start of the step: sum, and moment about the
/// world's origin.
struct Given {
  Vec3 impulse = Vec3::Zero();
  Vec3 moment = Vec3::Zero();
};
inline Given give(const World& world, const ContactPoint& point, const Vec3& impulse) {
  Given out;
  for (int k = 0; k < point.count; ++k) {
    const Vec3 share = point.weight[k] * impulse;
    out.impulse += share;
    out.moment += Vec3(world.body(point.body).system.startPositions().segment<3>(3 * point.node[k])).cross(share);
  }
  return out;
}

/// Velocity of a contact point at the end of the step, from the bodies' own solution and not from the Delassus matrix.
inline Vec3 endVelocity(const World& world, const ContactPoint& point) {
  Vec3 v = Vec3::Zero();
  if (point.body < 0) return v;
  const Body body = world.body(point.body);
  for (int k = 0; k < point.count; ++k) {
    const int node = point.node[k];
    if (body.model.row()[node] >= 0) {
      v += point.weight[k] * body.system.endVelocity().segment<3>(3 * body.model.row()[node]);
    } else {
      const Vec3 lever = body.system.startPositions().segment<3>(3 * node) - body.system.startPose().position;
      v += point.weight[k] * (body.system.endTwist().head<3>() + Vec3(body.system.endTwist().tail<3>()).cross(lever));
    }
  }
  return v;
}

/// Greatest work that friction does in a contact in the last step [J], at the end velocities. Friction takes: not above
/// 0.
inline double worstFrictionPower(const World& world) {
  const ContactSet& set = world.contacts();
  double worst = -1e300;
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    const Contact& c = set.contacts[i];
    const Vec3 impulse = impulseOf(set, i);
    const Vec3 tangential = impulse - c.normal.dot(impulse) * c.normal;
    worst = std::max(worst, tangential.dot(endVelocity(world, c.first) - endVelocity(world, c.second)));
  }
  return worst;
}

/// Kinetic, elastic, and in the field of gravity [J]. A rigid body's four carriers have its center of mass.
inline double totalEnergy(const World& world) {
  double sum = 0;
  for (int i = 0; i < world.bodies(); ++i) sum += mechanicalEnergy(world, i);
  return sum;
}

/// Force of body or ground `lower` on body `upper` in the last step [N].
inline Vec3 forceBetween(const World& world, int upper, int lower) {
  const ContactSet& set = world.contacts();
  const double h = world.body(upper).system.input().step;
  Vec3 sum = Vec3::Zero();
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    const Contact& c = set.contacts[i];
    if (c.first.body == upper && c.second.body == lower) sum += impulseOf(set, i) / h;
    if (c.second.body == upper && c.first.body == lower) sum -= impulseOf(set, i) / h;
  }
  return sum;
}

/// Whether segment pq passes through triangle abc; written apart from the product's geometry.
inline bool crosses(const Vec3& p, const Vec3& q, const Vec3& a, const Vec3& b, const Vec3& c) {
  const auto volume = [](const Vec3& o, const Vec3& u, const Vec3& v, const Vec3& w) {
    return (u - o).dot((v - o).cross(w - o));
  };
  if (volume(p, a, b, c) * volume(q, a, b, c) >= 0) return false;
  const double s0 = volume(p, q, a, b);
  const double s1 = volume(p, q, b, c);
  const double s2 = volume(p, q, c, a);
  return (s0 > 0 && s1 > 0 && s2 > 0) || (s0 < 0 && s1 < 0 && s2 < 0);
}

/// Whether an edge and a triangle lie apart along an axis. By plain numbers: tests are not optimized.
inline bool apart(const Vec3& a, const Vec3& b, const Vec3& p, const Vec3& q, const Vec3& r) {
  const double *x = a.data(), *y = b.data(), *u = p.data(), *v = q.data(), *w = r.data();
  for (int k = 0; k < 3; ++k) {
    const double low = x[k] < y[k] ? x[k] : y[k], high = x[k] < y[k] ? y[k] : x[k];
    if (low > u[k] && low > v[k] && low > w[k]) return true;
    if (high < u[k] && high < v[k] && high < w[k]) return true;
  }
  return false;
}

/// Number of edges of one group of triangles that pass through triangles of another, by brute force.
inline int crossings(const std::vector<Vec3>& points, const std::vector<std::array<int, 3>>& one,
                     const std::vector<std::array<int, 3>>& other) {
  int count = 0;
  for (const auto& [edges, faces] : {std::pair(&one, &other), std::pair(&other, &one)}) {
    for (const auto& e : *edges) {
      for (int i = 0; i < 3; ++i) {
        for (const auto& f : *faces) {
          if (apart(points[e[i]], points[e[(i + 1) % 3]], points[f[0]], points[f[1]], points[f[2]])) continue;
          count += crosses(points[e[i]], points[e[(i + 1) % 3]], points[f[0]], points[f[1]], points[f[2]]) ? 1 : 0;
        }
      }
    }
  }
  return count;
}

}  // namespace palpate::test
