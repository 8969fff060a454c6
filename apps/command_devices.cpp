#include <fmt/format.h>

#include "commands.h"
#include "palpate/devices/simulated_device.h"

namespace palpate {
namespace {

void list() {
  const SimulatedDeviceSettings s;
  fmt::print(
      "simulated    mass and damping of a Phantom Omni, moved by a hand model: {:.3g} kg, {:.2g} N peak, {:.0f} N/m\n"
      "prescribed   follows the scene's keyframes exactly, whatever it feels\n"
      "recorded     replays a motion: --device recorded:FILE (motion.csv of any run)\n"
      "mouse        the simulated one with your hand at a pointer, a touch screen or a keyboard: palpate view\n"
      "No driver for hardware is built in.\n",
      s.mass, s.limits.peak_force, s.limits.stiffness);
}

}  // namespace

void addDevicesCommand(CLI::App& app) {
  app.add_subcommand("devices", "List the devices that a scene can use")->callback(list);
}

}  // namespace palpate
