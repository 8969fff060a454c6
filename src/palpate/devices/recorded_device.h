#pragma once

#include <cstddef>

#include "palpate/devices/device.h"
#include "palpate/devices/motion_recording.h"

namespace palpate {

/// Replays a recorded motion, whatever it feels. At the time of a row (within 1e-9 s) of a recording with twists the
/// row is returned as it is, so a replay is exact to the bit. In between, position goes linearly and rotation the short
/// way round at constant angular velocity, and a recording without twists has the right-hand difference as its
/// velocity. Rests in the first row before it and in the last one after it.
class RecordedDevice final : public Device {
 public:
  /// @throws InputError when the recording has no rows
  explicit RecordedDevice(MotionRecording recording, const DeviceLimits& limits = {});

  const char* name() const noexcept override { return "recorded"; }
  DeviceLimits limits() const noexcept override { return limits_; }
  DeviceState sample(double t) noexcept override;
  void apply(const Vec6&, double, double) noexcept override {}
  /// Nothing is remembered, as time alone says where the motion is; time may then begin anew anywhere.
  void restore(const DeviceMemory& memory) override;

  /// Time of the last row [s].
  double duration() const noexcept { return recording_.samples.back().time; }

 private:
  DeviceState between(const MotionSample& from, const MotionSample& to, double t) const noexcept;

  MotionRecording recording_;
  DeviceLimits limits_;
  std::size_t row_ = 0;  // newest row that is not after t; found again from here at the next sample
};

}  // namespace palpate
