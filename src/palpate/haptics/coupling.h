#pragma once

#include "palpate/haptics/device_state.h"
#include "palpate/math/rotation.h"

namespace palpate {

/// Viscoelastic link between the handle (or its proxy) and the device.
struct LinkParameters {
  double stiffness = 700.0;           ///< kd [N/m]
  double damping = 5.0;               ///< bd [N s/m]
  double rotational_stiffness = 1.0;  ///< kr [N m/rad]
  double rotational_damping = 0.005;  ///< br [N m s/rad]
};

/// The stiffest link that a device allows.
inline LinkParameters linkForDevice(const DeviceLimits& limits) {
  return {limits.stiffness, limits.damping, limits.rotational_stiffness, limits.rotational_damping};
}

/// Wrench of the link *on the device* [N; N m], about the handle's origin, world frame; the handle feels the opposite.
///   kd (x - xd) + bd (v - vd),   kr log(R Rd^T) + br (w - wd)
inline Vec6 couplingWrench(const LinkParameters& link, const Pose& pose, const Vec6& twist, const DeviceState& device) {
  const Vec6 stretch = poseDifference(pose, device.pose);
  const Vec6 rate = twist - device.twist;
  Vec6 wrench;
  wrench.head<3>() = link.stiffness * stretch.head<3>() + link.damping * rate.head<3>();
  wrench.tail<3>() = link.rotational_stiffness * stretch.tail<3>() + link.rotational_damping * rate.tail<3>();
  return wrench;
}

}  // namespace palpate
