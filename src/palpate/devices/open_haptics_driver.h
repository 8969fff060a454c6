#pragma once

#include <memory>
#include <vector>

#include "palpate/devices/driver_list.h"

namespace palpate {

/// 3D Systems Touch, Phantom Omni and kin through OpenHaptics' libHD, which is loaded at run time. The tick runs inside
/// the library's servo callback, one frame a tick.
std::shared_ptr<DeviceDriver> openOpenHaptics(const DeviceOptions& options, OpenFor purpose);
const std::vector<DeviceOption>& openHapticsOptions();

}  // namespace palpate
