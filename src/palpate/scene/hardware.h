#pragma once

#include <optional>
#include <string>

#include "palpate/devices/driver_list.h"
#include "palpate/scene/config.h"

namespace palpate {

/// Cause why the options do not fit the kind of device; none if all is well.
std::optional<std::string> deviceObjection(const DeviceConfig& device);

/// For a device on a desk: opens its driver, unless that is done. Limits, what the link defaults to and the ramp at the
/// start become those of the device, within the limits of the file; a link that is stiffer than the device bears is
/// cut, with a line in `device.notes`; the start gate is on unless the file says otherwise.
/// @throws RunError with the exact reason why there is no such device; InputError for settings that do not fit it
void openDevice(SceneConfig& config);

}  // namespace palpate
