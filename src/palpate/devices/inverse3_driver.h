#pragma once

#include <memory>
#include <vector>

#include "palpate/devices/driver_list.h"

namespace palpate {

/// Haply Inverse3 behind its service: WebSocket and JSON 3.x. A thread of its own exchanges one message for one answer,
/// up to `rate` times a second, whatever the tick does; without a new wrench for 50 ms it sends zero.
std::shared_ptr<DeviceDriver> openInverse3(const DeviceOptions& options, OpenFor purpose);
const std::vector<DeviceOption>& inverse3Options();

}  // namespace palpate
