#include "palpate/scene/hardware.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "palpate/common/error.h"
#include "palpate/devices/hardware_device.h"
#include "palpate/haptics/coupling.h"
#include "palpate/scene/text.h"

namespace palpate {
namespace {

constexpr double kStartRamp = 1.5;  // with a hand on the device [s]

const DriverKind& kindOf(const DeviceConfig& device) {
  return driverKinds()[static_cast<std::size_t>(device.kind) - static_cast<std::size_t>(DeviceName::inverse3)];
}

DeviceLimits within(DeviceLimits limits, const DeviceLimits& caps) {
  limits.peak_force = std::min(limits.peak_force, caps.peak_force);
  limits.continuous_force = std::min({limits.continuous_force, caps.continuous_force, limits.peak_force});
  limits.peak_torque = std::min(limits.peak_torque, caps.peak_torque);
  limits.stiffness = std::min(limits.stiffness, caps.stiffness);
  limits.damping = std::min(limits.damping, caps.damping);
  limits.rotational_stiffness = std::min(limits.rotational_stiffness, caps.rotational_stiffness);
  limits.rotational_damping = std::min(limits.rotational_damping, caps.rotational_damping);
  limits.workspace_radius = std::min(limits.workspace_radius, caps.workspace_radius);
  return limits;
}

void cut(double& value, double limit, const char* what, const char* unit, std::vector<std::string>& notes) {
  if (!(value > limit)) return;
  notes.push_back(
      fmt::format("the scene's {} of {:.4g} {} is cut to what the device bears, {:.4g}", what, value, unit, limit));
  value = limit;
}

}  // namespace

std::optional<std::string> deviceObjection(const DeviceConfig& device) {
  if (device.options.values().empty()) return std::nullopt;
  if (!isHardware(device.kind)) return fmt::format("{} has no options", toString(device.kind));
  std::vector<std::string> known;
  for (const DeviceOption& o : kindOf(device).options) known.emplace_back(o.key);
  for (const DeviceOption& o : workspaceOptions()) known.emplace_back(o.key);
  for (const auto& [key, value] : device.options.values()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    return fmt::format("unknown option {}; the nearest known option is \"{}\"", shownText(key),
                       nearestWord(key, known));
  }
  try {
    workspaceSettings(device.options);
  } catch (const InputError& e) {
    return e.what();
  }
  return std::nullopt;
}

void openDevice(SceneConfig& config) {
  DeviceConfig& d = config.device;
  if (!isHardware(d.kind)) return;
  if (!d.driver) d.driver = kindOf(d).open(d.options, OpenFor::running);
  const DriverInfo& info = d.driver->info();
  if (d.driver->keepsTime() && std::abs(info.rate * config.haptic_step - 1.0) > 0.1) {
    throw InputError("haptic", "step",
                     fmt::format("{:g} s does not fit {}, which ticks by itself at {:g} Hz", config.haptic_step,
                                 info.name, info.rate));
  }
  d.limits = within(worldLimits(info, workspaceSettings(d.options), config.haptic_step), d.caps);
  config.link = config.link_given.over(linkForDevice(d.limits));
  d.notes.clear();
  if (info.has_force) {
    cut(config.link.stiffness, d.limits.stiffness, "link stiffness", "N/m", d.notes);
    cut(config.link.damping, d.limits.damping, "link damping", "N s/m", d.notes);
    if (!config.safety.start_gate) config.safety.settings.presence.start_gate = true;
  }
  if (d.limits.peak_torque > 0.0) {
    cut(config.link.rotational_stiffness, d.limits.rotational_stiffness, "link rotational_stiffness", "N m/rad",
        d.notes);
    cut(config.link.rotational_damping, d.limits.rotational_damping, "link rotational_damping", "N m s/rad", d.notes);
  }
  if (config.safety.settings.start_ramp <= 0.0) config.safety.settings.start_ramp = kStartRamp;
}

}  // namespace palpate
