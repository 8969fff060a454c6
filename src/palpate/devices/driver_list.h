#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/devices/device_options.h"
#include "palpate/devices/driver.h"

namespace palpate {

/// What a device is opened for.
enum class OpenFor {
  looking,  ///< a listing: no force, nothing moves by itself
  running,  ///< ticks follow
};

/// A kind of device that there is a driver for.
struct DriverKind {
  const char* name;                   ///< of `device: type:` and --device
  const char* what;                   ///< for listings
  std::vector<DeviceOption> options;  ///< of the driver, besides workspaceOptions()
  /// @throws RunError with the exact reason why there is no such device, InputError for a bad option
  std::shared_ptr<DeviceDriver> (*open)(const DeviceOptions&, OpenFor);
};

/// All kinds, in the order of DeviceName's.
const std::vector<DriverKind>& driverKinds();

}  // namespace palpate
