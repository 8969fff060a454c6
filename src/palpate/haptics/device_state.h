#pragma once

#include <cstdint>
#include <limits>

#include "palpate/math/types.h"

namespace palpate {

/// What a device reports at one instant; world frame, after the scene's mapping.
struct DeviceState {
  Pose pose;
  Vec6 twist = Vec6::Zero();
  std::uint32_t buttons = 0;  ///< bit k: button k + 1 is pressed
  // What the device renders now, below its limits: warm motors, a clutch, a device that comes back.
  double force_limit = std::numeric_limits<double>::infinity();   ///< [N]
  double torque_limit = std::numeric_limits<double>::infinity();  ///< [N m]
};

/// What a device can render. Coupling parameters default to what these allow.
struct DeviceLimits {
  double peak_force = 3.3;            ///< [N]
  double continuous_force = 0.88;     ///< [N]
  double peak_torque = 0.1;           ///< [N m]; 0 for a device without torque output
  double stiffness = 700.0;           ///< largest stable coupling stiffness [N/m]
  double damping = 5.0;               ///< [N s/m]
  double rotational_stiffness = 1.0;  ///< [N m/rad]
  double rotational_damping = 0.005;  ///< [N m s/rad]
  double workspace_radius = 0.10;     ///< [m]
};

}  // namespace palpate
