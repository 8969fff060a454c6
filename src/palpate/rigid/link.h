#pragma once

#include "palpate/math/rotation.h"
#include "palpate/math/types.h"

namespace palpate {

/// Viscoelastic link between a handle (or its proxy) and the device.
struct LinkParameters {
  double stiffness = 700.0;           ///< kd [N/m]
  double damping = 5.0;               ///< bd [N s/m]
  double rotational_stiffness = 1.0;  ///< kr [N m/rad]
  double rotational_damping = 0.005;  ///< br [N m s/rad]
};

/// Wrench of the link on the device: kd (x - xd) + bd (v - vd), kr log(R Rd^T) + br (w - wd); about the handle's
/// origin, world frame [N; N m]. The handle feels its negative.
inline Vec6 linkWrenchOnDevice(const LinkParameters& link, const Pose& handle, const Vec6& twist, const Pose& device,
                               const Vec6& device_twist) {
  const Vec6 offset = poseDifference(handle, device);
  const Vec6 slip = twist - device_twist;
  Vec6 wrench;
  wrench.head<3>() = link.stiffness * offset.head<3>() + link.damping * slip.head<3>();
  wrench.tail<3>() = link.rotational_stiffness * offset.tail<3>() + link.rotational_damping * slip.tail<3>();
  return wrench;
}

}  // namespace palpate
