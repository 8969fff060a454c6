#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/devices/driver_list.h"

namespace palpate {

/// SpaceNavigator and kin through spacenavd's socket, protocol 0 and 1: input only. Its deflection is a velocity.
std::shared_ptr<DeviceDriver> openSpacenav(const DeviceOptions& options, OpenFor purpose);
const std::vector<DeviceOption>& spacenavOptions();

/// One event of the protocol: eight numbers of 32 bits in the machine's order.
using SpacenavPacket = std::array<std::int32_t, 8>;

/// A deflection as its twist in the driver's frame, each component -1 to 1 at 500; less than the dead zone is none.
/// The protocol's x is right, y up, z away from the person: with z and rz negated it is right-handed.
Vec6 spacenavDeflection(const SpacenavPacket& motion, int dead_zone);

}  // namespace palpate
