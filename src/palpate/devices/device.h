#pragma once

#include "palpate/devices/device_memory.h"
#include "palpate/haptics/device_state.h"

namespace palpate {

/// A haptic device, or something that stands for one. sample() and apply() are called from the haptic tick: they
/// neither block, allocate nor throw. Opening, which may fail, is the constructor's work.
class Device {
 public:
  virtual ~Device() = default;
  virtual const char* name() const noexcept = 0;
  virtual DeviceLimits limits() const noexcept = 0;
  /// Before the first tick: the run begins at rest, and the hand already carries `wrench` [N; N m], world frame, about
  /// the handle's origin. Nothing to do for a device that a person holds, or that feels nothing.
  virtual void begin(const Vec6& /*wrench*/) noexcept {}
  /// State at time t [s] since the start of the run; t does not decrease, but by restore().
  virtual DeviceState sample(double t) noexcept = 0;
  /// Commands the wrench on the device [N; N m], world frame, about the handle's origin, held for the tick [t, t + dt).
  virtual void apply(const Vec6& wrench, double t, double dt) noexcept = 0;

  /// What the device must remember between two ticks. Given back to a device that was built alike, it makes the run go
  /// on to the bit. Nothing for a device that depends on time alone, and for real ones, which cannot go back.
  virtual DeviceMemory save() const { return {}; }
  /// Between two ticks. @throws InputError for what is not of this kind of device; then nothing has changed
  virtual void restore(const DeviceMemory& memory) { MemoryReader(memory, 0, name()); }
};

}  // namespace palpate
