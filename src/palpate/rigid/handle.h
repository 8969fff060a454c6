#pragma once

#include <string>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Where a handle is and how it moves.
struct HandleState {
  Pose pose;
  Vec6 twist = Vec6::Zero();  ///< velocity of the origin and angular velocity, world [m/s; rad/s]
};

/// Rigid handle with the tool's nodes that are attached to it: x_i = p + R r_i, velocity G_i u, G_i = [I, -[R r_i]x].
/// Its origin p is the center of mass of handle and attached nodes; the handle's own mass is centered on the attached
/// nodes' center of mass, so no weight has a moment about p. What moves is in HandleState.
struct Handle {
  std::string name;
  std::vector<int> nodes;                ///< attached nodes of the tool's mesh
  std::vector<Vec3> offsets;             ///< r_i in the handle's frame, one an attached node [m]
  double mass = 0;                       ///< handle and attached nodes [kg]
  Mat3 inertia = Mat3::Zero();           ///< handle and attached nodes, about p, handle's frame [kg m^2]
  double attached_mass = 0;              ///< attached nodes alone [kg]
  Mat3 attached_inertia = Mat3::Zero();  ///< attached nodes alone, about p, handle's frame [kg m^2]
  HandleState start;                     ///< of a run

  /// R I R^T [kg m^2].
  Mat3 worldInertia(const Pose& pose) const { return pose.matrix() * inertia * pose.matrix().transpose(); }
  /// M_h, 6x6: mass and world inertia.
  Mat6 massMatrix(const Pose& pose) const;
  /// G_i of the k-th attached node, 3x6.
  Eigen::Matrix<double, 3, 6> jacobian(int k, const Pose& pose) const;
  Vec3 nodePosition(int k, const Pose& pose) const { return pose.apply(offsets[k]); }
  Vec3 nodeVelocity(int k, const HandleState& state) const;
};

/// No handle is smaller than what fingers hold [m].
inline constexpr double kLeastHandleRadius = 0.01;

/// Mass and inertia of the handle itself on top of what is attached to it.
/// @param own_inertia  diagonal, handle's frame [kg m^2]; where not positive, that of a ball of this radius [m]
void addOwnMass(double own_mass, const Vec3& own_inertia, double radius, Handle& handle);

/// Handle on the given nodes.
/// @param positions  of the attached nodes [m], world
/// @param masses     of the attached nodes [kg]
/// @param own_mass   of the handle itself [kg], > 0
/// @param own_inertia  diagonal, handle's frame [kg m^2]; where not positive, that of a ball that reaches the nodes
/// @param rotation   the handle's frame at the start
/// @throws InputError if there is no node or the mass is not positive
Handle makeHandle(const std::string& name, const std::vector<int>& nodes, const std::vector<Vec3>& positions,
                  const std::vector<double>& masses, double own_mass, const Vec3& own_inertia, const Quat& rotation);

/// Indices of the points that a region contains, increasing.
/// @param points  of a mesh, say at rest [m]
/// @param region  predicate of a point
template <class Region>
std::vector<int> nodesWhere(const std::vector<Vec3>& points, const Region& region) {
  std::vector<int> nodes;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (region(points[i])) nodes.push_back(static_cast<int>(i));
  }
  return nodes;
}

/// makeHandle() of a body: takes from the positions and masses of all its nodes what belongs to those attached.
/// @param nodes      attached
/// @param positions  of all nodes [m], world
/// @param masses     of all nodes [kg]
Handle handleOnNodes(const std::string& name, const std::vector<int>& nodes, const std::vector<Vec3>& positions,
                     const VecX& masses, double own_mass, const Vec3& own_inertia, const Quat& rotation);

}  // namespace palpate
