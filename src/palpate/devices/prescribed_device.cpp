#include "palpate/devices/prescribed_device.h"

#include <utility>

namespace palpate {

PrescribedDevice::PrescribedDevice(Path path, const Pose& start, const DeviceLimits& limits)
    : path_(std::move(path)), start_(start), limits_(limits) {}

DeviceState PrescribedDevice::sample(double t) noexcept {
  const Path::Point point = path_.at(t, start_);
  return {point.pose, point.twist, 0};
}

}  // namespace palpate
