#pragma once

#include "palpate/haptics/device_state.h"
#include "palpate/rigid/link.h"

namespace palpate {

/// The stiffest link that a device allows.
inline LinkParameters linkForDevice(const DeviceLimits& limits) {
  return {limits.stiffness, limits.damping, limits.rotational_stiffness, limits.rotational_damping};
}

/// Wrench of the link *on the device* [N; N m], about the handle's origin, world frame; the handle feels the opposite.
///   kd (x - xd) + bd (v - vd),   kr log(R Rd^T) + br (w - wd),   each within its limit
inline Vec6 couplingWrench(const LinkParameters& link, const Pose& pose, const Vec6& twist, const DeviceState& device) {
  return saturatedWrenchOnDevice(link, pose, twist, device.pose, device.twist);
}

}  // namespace palpate
