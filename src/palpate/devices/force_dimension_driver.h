#pragma once

#include <memory>
#include <vector>

#include "palpate/devices/driver_list.h"

namespace palpate {

/// Force Dimension's devices and the Novint Falcon, through libdrd or libdhd, which is loaded at run time. The
/// firmware's watchdog and velocity limit are on.
std::shared_ptr<DeviceDriver> openForceDimension(const DeviceOptions& options, OpenFor purpose);
const std::vector<DeviceOption>& forceDimensionOptions();

}  // namespace palpate
