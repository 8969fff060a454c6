#include "palpate/scene/overrides.h"

#include <fmt/format.h>

#include <algorithm>

#include "palpate/common/error.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/hardware.h"
#include "palpate/scene/limits.h"
#include "palpate/scene/reader.h"

namespace palpate {
namespace {

[[noreturn]] void fail(const char* option, const std::string& cause) { throw InputError(option, "", cause); }

void failOn(const char* option, const std::optional<std::string>& cause) {
  if (cause) fail(option, *cause);
}

template <typename Enum>
void choose(const char* option, const std::optional<std::string>& word, const std::vector<std::string>& words,
            Enum& target) {
  if (!word) return;
  const auto found = std::find(words.begin(), words.end(), *word);
  if (found == words.end()) fail(option, fmt::format("{} is not one of {}", shownText(*word), fmt::join(words, ", ")));
  target = static_cast<Enum>(found - words.begin());
}

void setNumber(const char* option, const std::optional<double>& value, const Range& range, double& target) {
  if (!value) return;
  failOn(option, objection(*value, range));
  target = *value;
}

void setInteger(const char* option, const std::optional<long long>& value, int low, int high, int& target) {
  if (!value) return;
  if (*value < low || *value > high)
    fail(option, fmt::format("{} is out of range; it must be from {} to {}", *value, low, high));
  target = static_cast<int>(*value);
}

void setDevice(const std::string& device, DeviceConfig& config) {
  const std::string prefix = "recorded:";
  if (device.starts_with(prefix)) {
    const std::string file = device.substr(prefix.size());
    std::error_code error;
    if (!std::filesystem::is_regular_file(file, error))
      fail("--device", fmt::format("no such file {}", shownText(file, 400)));
    config.kind = DeviceName::recorded;
    config.recording = FileReference{file, "", std::filesystem::path(file)};
    return;
  }
  const bool had_recording = config.recording.has_value();
  const std::size_t colon = device.find(':');
  const DeviceName before = config.kind;
  choose("--device", device.substr(0, colon), deviceNames(), config.kind);
  if (config.kind != before) config.options = {};
  if (colon != std::string::npos) {
    if (!isHardware(config.kind)) fail("--device", fmt::format("{} has no options", toString(config.kind)));
    auto values = config.options.values();
    const DeviceOptions given = DeviceOptions::parse(device.substr(colon + 1));
    for (const auto& [key, value] : given.values()) values[key] = value;
    config.options = DeviceOptions(std::move(values));
  }
  if (isHardware(config.kind)) failOn("--device", deviceObjection(config));
  if (config.kind == DeviceName::recorded && !had_recording)
    fail("--device", "a recording is needed; write recorded:FILE");
  if (config.kind != DeviceName::recorded) config.recording.reset();
}

void setTetrahedra(const std::optional<long long>& tetrahedra, SceneConfig& config) {
  if (!tetrahedra) return;
  if (config.tool.rigid) fail("--tetrahedra", "the scene's tool is rigid");
  if (std::holds_alternative<BarShapeConfig>(config.tool.shape) ||
      std::holds_alternative<TetrahedraFileShapeConfig>(config.tool.shape))
    fail("--tetrahedra", "the scene's tool has tetrahedra of its own; only embedded surfaces take a count");
  setInteger("--tetrahedra", tetrahedra, limits::kMinTetrahedra, limits::kTetrahedra, config.tool.tetrahedra);
  failOn("--tetrahedra", sizeObjection(config));
}

}  // namespace

void applyOverrides(SceneConfig& config, const Overrides& overrides) {
  SceneConfig changed = config;
  choose("--method", overrides.method, methodNames(), changed.method);
  failOn("--method", methodObjection(changed));
  choose("--aim", overrides.aim, aimNames(), changed.aim);
  choose("--derivative", overrides.derivative, derivativeNames(), changed.derivative);
  choose("--cone", overrides.cone, coneNames(), changed.contact.settings.cone.exact);
  if (overrides.handle) {
    failOn("--handle", handleObjection(changed.tool, *overrides.handle));
    changed.tool.handle = *overrides.handle;
  }
  if (overrides.device) setDevice(*overrides.device, changed.device);
  setNumber("--duration", overrides.duration, limits::kDuration, changed.duration);
  if (overrides.duration) failOn("--duration", timingObjection(changed));
  setNumber("--visual-dt", overrides.visual_dt, limits::kVisualStep, changed.visual_step);
  if (overrides.visual_dt) failOn("--visual-dt", timingObjection(changed));
  if (overrides.visual_dt || overrides.visual_auto) changed.visual_step_auto = overrides.visual_auto;
  setInteger("--latency", overrides.latency, 0, limits::kLatency, changed.latency);
  setInteger("--jitter", overrides.jitter, 0, limits::kLatency, changed.jitter);
  changed.seed = overrides.seed.value_or(changed.seed);
  setTetrahedra(overrides.tetrahedra, changed);
  config = std::move(changed);
}

}  // namespace palpate
