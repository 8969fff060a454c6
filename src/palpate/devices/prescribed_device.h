#pragma once

#include "palpate/devices/device.h"
#include "palpate/devices/path.h"

namespace palpate {

/// A device that follows a path, whatever it feels.
class PrescribedDevice final : public Device {
 public:
  PrescribedDevice(Path path, const Pose& start, const DeviceLimits& limits = {});

  const char* name() const noexcept override { return "prescribed"; }
  DeviceLimits limits() const noexcept override { return limits_; }
  DeviceState sample(double t) noexcept override;
  void apply(const Vec6&, double, double) noexcept override {}

 private:
  Path path_;
  Pose start_;
  DeviceLimits limits_;
};

}  // namespace palpate
