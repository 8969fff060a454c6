#pragma once

// A bar on the ground, handles on some of a body's nodes, and what a world is measured by: momentum, energy, contact
// forces, depth.

#include <algorithm>
#include <concepts>
#include <string>
#include <utility>
#include <vector>

#include "palpate/math/rotation.h"
#include "palpate/mesh/shapes.h"
#include "palpate/simulation/world.h"
#include "shared/analytic_solids.h"

namespace palpate::test {

inline const Vec3 kBarSize(0.06, 0.04, 0.03);  // [m]

/// The nodes of a mesh moved; its surface is embedded and follows.
inline SimulationMesh moved(SimulationMesh mesh, const Pose& pose) {
  for (Vec3& p : mesh.mesh.nodes) p = pose.apply(p);
  for (Vec3& p : mesh.surface.vertices) p = pose.apply(p);
  return mesh;
}

/// Bar with its bottom at z = 0, free or held at the nodes that `region` selects by their rest position.
inline BodyModel bar(const std::array<int, 3>& cells, const Material& material, double friction = 0.5,
                     const Vec6& velocity = Vec6::Zero()) {
  return BodyModel("bar", barMesh(kBarSize, cells), material, friction, velocity);
}

/// A handle of tests and benchmarks.
struct HandleOptions {
  std::string name = "handle";
  double mass = 0.02;                             ///< of its own [kg]
  Vec3 inertia{1e-5, 2e-5, 3e-5};                 ///< of its own; zero: that of a ball that reaches the nodes [kg m^2]
  Quat rotation = expRotation({0.3, -0.2, 0.1});  ///< askew, so that no axis is special
  Vec6 twist = Vec6::Zero();
};
/// A handle whose frame is the world's.
inline const HandleOptions kPlainHandle{"handle", 0.02, Vec3::Zero(), Quat::Identity(), Vec6::Zero()};

inline void holdNodes(BodyModel& body, const std::vector<int>& nodes, const HandleOptions& options = {}) {
  Handle handle = handleOnNodes(options.name, nodes, body.mesh().mesh.nodes, body.elasticity().mass(), options.mass,
                                options.inertia, options.rotation);
  handle.start.twist = options.twist;
  body.hold(handle);
}
/// @param region  of the rest positions
template <class Region>
requires std::predicate<Region, Vec3>
void holdNodes(BodyModel& body, const Region& region, const HandleOptions& options = {}) {
  holdNodes(body, nodesWhere(body.mesh().mesh.nodes, region), options);
}

/// A bar that hangs by a handle at its upper end, which the device holds stiffly; as it was built, not at rest.
inline World hangingBar(const Vec3& size, const std::array<int, 3>& cells, const Material& material) {
  World world;
  world.link.stiffness = 1e5;
  world.link.rotational_stiffness = 1e3;
  BodyModel body("bar", barMesh(size, cells), material);
  holdNodes(
      body, [&](const Vec3& x) { return x.z() > size.z() * (1 - 1e-9); }, kPlainHandle);
  world.add(std::move(body));
  return world;
}

inline bool onTop(const Vec3& p) { return p.z() > kBarSize.z() - 1e-9; }
inline bool onBottom(const Vec3& p) { return p.z() < 1e-9; }

inline Obstacle ground(double friction = 0.5) { return {PlaneShape{}, friction, "ground"}; }

inline Vec3 momentum(const Body& body) {
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < body.model.nodes(); ++i)
    sum += body.model.elasticity().mass()[i] * body.state.velocities.segment<3>(3 * i);
  if (body.model.framed())
    sum += (body.model.handle().mass - body.model.handle().attached_mass) * body.state.handle.twist.head<3>();
  return sum;
}

inline Vec3 centerVelocity(const Body& body) { return momentum(body) / body.model.totalMass(); }

inline Vec3 center(const Body& body) {
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < body.model.nodes(); ++i)
    sum += body.model.elasticity().mass()[i] * body.state.positions.segment<3>(3 * i);
  return sum / body.model.elasticity().mass().sum();
}

/// Force of all contacts of a body on it, and the sum of their normal parts.
struct ContactForce {
  Vec3 total = Vec3::Zero();
  double normal = 0;
};
inline ContactForce contactForce(const World& world, int body) {
  ContactForce out;
  const ContactSet& set = world.contacts();
  const double h = world.body(body).system.input().step;
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    const Vec3 impulse = set.impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
    const Vec3 force = set.contacts[i].frame().transpose() * impulse / h;
    if (set.contacts[i].first.body == body) out.total += force;
    if (set.contacts[i].second.body == body) out.total -= force;
    out.normal += impulse[0] / h;
  }
  return out;
}

/// Depth of the deepest surface vertex in any analytic obstacle, by brute force [m].
inline double deepestVertex(const World& world, int index) {
  const Body body = world.body(index);
  double deepest = 0;
  for (const EmbeddedPoint& e : body.model.mesh().embedding) {
    Vec3 p = Vec3::Zero();
    for (int k = 0; k < 4; ++k) {
      p += e.weights[k] * body.state.positions.segment<3>(3 * body.model.mesh().mesh.tetrahedra[e.tetrahedron][k]);
    }
    for (const Obstacle& o : world.obstacles) {
      deepest = std::max(deepest, -std::visit([&](const auto& shape) { return signedDistance(shape, p); }, o.shape));
    }
  }
  return deepest;
}

/// Elastic energy with the rotations of the present positions; a step leaves those of its start.
inline double elasticEnergy(const Body& body) {
  ElasticState turned = body.state.elastic;
  body.model.elasticity().updateRotations(body.state.positions, turned);
  return body.model.elasticity().energy(body.state.positions, turned);
}

inline double mechanicalEnergy(const World& world, int index) {
  const Body body = world.body(index);
  return body.model.kineticEnergy(body.state) + elasticEnergy(body) -
         body.model.totalMass() * world.gravity.dot(center(body));
}

}  // namespace palpate::test
