#include "palpate/rigid/handle.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"

namespace palpate {

Mat6 Handle::massMatrix(const Pose& pose) const {
  Mat6 m = Mat6::Zero();
  m.topLeftCorner<3, 3>().diagonal().setConstant(mass);
  m.bottomRightCorner<3, 3>() = worldInertia(pose);
  return m;
}

Eigen::Matrix<double, 3, 6> Handle::jacobian(int k, const Pose& pose) const {
  Eigen::Matrix<double, 3, 6> g;
  g.leftCols<3>().setIdentity();
  g.rightCols<3>() = -skew(pose.rotation * offsets[k]);
  return g;
}

Vec3 Handle::nodeVelocity(int k, const HandleState& state) const {
  return state.twist.head<3>() + Vec3(state.twist.tail<3>()).cross(state.pose.rotation * offsets[k]);
}

Handle makeHandle(const std::string& name, const std::vector<int>& nodes, const std::vector<Vec3>& positions,
                  const std::vector<double>& masses, double own_mass, const Vec3& own_inertia, const Quat& rotation) {
  if (nodes.empty()) throw InputError("handle " + name, "region", "holds no node of the simulation mesh");
  if (!(own_mass > 0) || !std::isfinite(own_mass)) throw InputError("handle " + name, "mass", "must be positive");
  Handle h;
  h.name = name;
  h.nodes = nodes;
  Vec3 center = Vec3::Zero();
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    h.attached_mass += masses[i];
    center += masses[i] * positions[i];
  }
  if (h.attached_mass > 0) {
    center /= h.attached_mass;
  } else {  // massless nodes: their centroid
    center.setZero();
    for (const Vec3& p : positions) center += p / static_cast<double>(positions.size());
  }
  h.start.pose = {center, rotation.normalized()};
  double radius = kLeastHandleRadius;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const Vec3 r = h.start.pose.rotation.conjugate() * (positions[i] - center);
    h.offsets.push_back(r);
    h.attached_inertia += masses[i] * (r.squaredNorm() * Mat3::Identity() - r * r.transpose());
    radius = std::max(radius, r.norm());
  }
  addOwnMass(own_mass, own_inertia, radius, h);
  return h;
}

void addOwnMass(double own_mass, const Vec3& own_inertia, double radius, Handle& handle) {
  handle.mass = own_mass + handle.attached_mass;
  const double ball = 0.4 * own_mass * radius * radius;
  handle.inertia = handle.attached_inertia;
  for (int k = 0; k < 3; ++k) handle.inertia(k, k) += own_inertia[k] > 0 ? own_inertia[k] : ball;
}

Handle handleOnNodes(const std::string& name, const std::vector<int>& nodes, const std::vector<Vec3>& positions,
                     const VecX& masses, double own_mass, const Vec3& own_inertia, const Quat& rotation) {
  if (nodes.empty() && !positions.empty()) {
    Vec3 low = positions.front(), high = low;
    for (const Vec3& p : positions) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    const auto text = [](const Vec3& v) { return fmt::format("({:.3g}, {:.3g}, {:.3g})", v.x(), v.y(), v.z()); };
    throw InputError("handle " + name, "region",
                     "holds no node of the simulation mesh, which lies from " + text(low) + " to " + text(high) + " m");
  }
  std::vector<Vec3> attached_positions;
  std::vector<double> attached_masses;
  for (const int i : nodes) {
    attached_positions.push_back(positions[i]);
    attached_masses.push_back(masses[i]);
  }
  return makeHandle(name, nodes, attached_positions, attached_masses, own_mass, own_inertia, rotation);
}

}  // namespace palpate
