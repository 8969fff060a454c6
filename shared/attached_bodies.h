#pragma once

// Bodies that the world holds, for tests.

#include <string>
#include <utility>
#include <vector>

#include "shared/held_scenes.h"

namespace palpate::test {

inline constexpr double kDown = 9.81;  ///< of gravity [m/s^2]

template <class Region>
Attachment fixed(const BodyModel& body, const Region& region, const std::string& name = "wall") {
  Attachment out;
  out.name = name;
  out.nodes = nodesWhere(body.mesh().mesh.nodes, region);
  return out;
}

/// Springs of the given stiffness in all, shared evenly.
template <class Region>
Attachment springs(const BodyModel& body, const Region& region, double stiffness, double damping = 0) {
  Attachment out = fixed(body, region, "ligament");
  const auto n = static_cast<Eigen::Index>(out.nodes.size());
  out.stiffness = VecX::Constant(n, stiffness / static_cast<double>(n));
  out.damping = VecX::Constant(n, damping / static_cast<double>(n));
  return out;
}

inline Material material(double youngs_modulus) {
  Material m;
  m.youngs_modulus = youngs_modulus;
  m.poisson_ratio = 0.0;
  m.density = 1000;
  return m;
}

/// A world with one body, which starts at rest in its rest shape.
inline World alone(BodyModel body) {
  World world;
  world.gravity = {0, 0, -kDown};
  world.add(std::move(body));
  return world;
}

/// How much higher nodes are than as built, on average [m].
inline double meanHeight(const Body& body, const std::vector<int>& nodes) {
  double sum = 0;
  for (const int n : nodes) sum += body.state.positions[3 * n + 2] - body.model.mesh().mesh.nodes[n].z();
  return sum / static_cast<double>(nodes.size());
}

}  // namespace palpate::test
