#pragma once

#include <algorithm>
#include <limits>

#include "palpate/math/rotation.h"
#include "palpate/math/types.h"

namespace palpate {

/// Viscoelastic link between a handle (or its proxy) and the device.
struct LinkParameters {
  double stiffness = 700.0;           ///< kd [N/m]
  double damping = 5.0;               ///< bd [N s/m]
  double rotational_stiffness = 1.0;  ///< kr [N m/rad]
  double rotational_damping = 0.005;  ///< br [N m s/rad]
  /// Where its spring, and its damper, saturates, as motors do [N], [N m]. Without a limit a hand that is far ahead
  /// crushes a soft tool.
  double peak_force = std::numeric_limits<double>::infinity();
  double peak_torque = std::numeric_limits<double>::infinity();
};

/// kd (x - xd) + bd (v - vd), kr log(R Rd^T) + br (w - wd), from the differences of poses and twists [N; N m].
inline Vec6 linkWrench(const LinkParameters& link, const Vec6& offset, const Vec6& slip) {
  Vec6 wrench;
  wrench.head<3>() = link.stiffness * offset.head<3>() + link.damping * slip.head<3>();
  wrench.tail<3>() = link.rotational_stiffness * offset.tail<3>() + link.rotational_damping * slip.tail<3>();
  return wrench;
}

/// Wrench of the link on the device, without its limits; about the handle's origin, world frame [N; N m]. The handle
/// feels its negative.
inline Vec6 linkWrenchOnDevice(const LinkParameters& link, const Pose& handle, const Vec6& twist, const Pose& device,
                               const Vec6& device_twist) {
  return linkWrench(link, poseDifference(handle, device), twist - device_twist);
}

/// The link from a given state on: a spring or damper that would pull there with more than the link's limit is softer
/// by as much. So it stays passive, and what solves for it linear.
inline LinkParameters saturated(const LinkParameters& link, const Vec6& offset, const Vec6& slip) {
  const auto within = [](double coefficient, double length, double limit) {
    return coefficient * length > limit ? limit / length : coefficient;
  };
  LinkParameters out = link;
  out.stiffness = within(link.stiffness, offset.head<3>().norm(), link.peak_force);
  out.damping = within(link.damping, slip.head<3>().norm(), link.peak_force);
  out.rotational_stiffness = within(link.rotational_stiffness, offset.tail<3>().norm(), link.peak_torque);
  out.rotational_damping = within(link.rotational_damping, slip.tail<3>().norm(), link.peak_torque);
  return out;
}
inline LinkParameters saturated(const LinkParameters& link, const Pose& handle, const Vec6& twist, const Pose& device,
                                const Vec6& device_twist) {
  return saturated(link, poseDifference(handle, device), twist - device_twist);
}

/// Energy of the link's springs within its limits: beyond them the force stays what it is there [J].
inline double linkEnergy(const LinkParameters& link, const Vec6& offset) {
  const auto of = [](double stiffness, double length, double limit) {
    return stiffness * length <= limit ? 0.5 * stiffness * length * length : limit * (length - 0.5 * limit / stiffness);
  };
  return of(link.stiffness, offset.head<3>().norm(), link.peak_force) +
         of(link.rotational_stiffness, offset.tail<3>().norm(), link.peak_torque);
}

/// linkWrenchOnDevice() within the link's limits.
inline Vec6 saturatedWrenchOnDevice(const LinkParameters& link, const Pose& handle, const Vec6& twist,
                                    const Pose& device, const Vec6& device_twist) {
  const Vec6 offset = poseDifference(handle, device), slip = twist - device_twist;
  return linkWrench(saturated(link, offset, slip), offset, slip);
}

}  // namespace palpate
