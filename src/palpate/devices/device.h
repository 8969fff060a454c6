#pragma once

#include "palpate/haptics/device_state.h"

namespace palpate {

/// A haptic device, or something that stands for one. Both calls are made from the haptic tick: they neither block,
/// allocate nor throw. Opening, which may fail, is the constructor's work.
class Device {
 public:
  virtual ~Device() = default;
  virtual const char* name() const noexcept = 0;
  virtual DeviceLimits limits() const noexcept = 0;
  /// State at time t [s] since the start of the run; t does not decrease.
  virtual DeviceState sample(double t) noexcept = 0;
  /// Commands the wrench on the device [N; N m], world frame, about the handle's origin, held for the tick [t, t + dt).
  virtual void apply(const Vec6& wrench, double t, double dt) noexcept = 0;
};

}  // namespace palpate
