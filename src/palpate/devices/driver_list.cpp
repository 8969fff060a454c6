#include "palpate/devices/driver_list.h"

#include "palpate/devices/force_dimension_driver.h"
#include "palpate/devices/inverse3_driver.h"
#include "palpate/devices/open_haptics_driver.h"
#include "palpate/devices/spacenav_driver.h"

namespace palpate {

const std::vector<DriverKind>& driverKinds() {
  static const std::vector<DriverKind> kinds{
      {"inverse3", "Haply Inverse3, Inverse3x, Minverse, through its service", inverse3Options(), openInverse3},
      {"touch", "3D Systems Touch, Phantom Omni, through OpenHaptics", openHapticsOptions(), openOpenHaptics},
      {"force_dimension", "Force Dimension and Novint Falcon, through its SDK", forceDimensionOptions(),
       openForceDimension},
      {"spacenavigator", "SpaceNavigator, SpaceMouse, through spacenavd; no force", spacenavOptions(), openSpacenav}};
  return kinds;
}

}  // namespace palpate
