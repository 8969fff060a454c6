#include "palpate/scene/reader.h"
#include "palpate/live/live_model.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>

#include "palpate/common/error.h"
#include "palpate/haptics/coupling.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/hardware.h"
#include "palpate/scene/limits.h"
#include "palpate/scene/read_parts.h"
#include "palpate/scene/schema.h"

namespace palpate {
namespace {

using namespace reading;

constexpr int kSchemaVersion = 1;
constexpr std::size_t kMaxBodies = 100;
constexpr std::size_t kMaxObstacles = 1000;
constexpr int kMaxSubsteps = 1000;

// Link, device, safety
// ----------------------------------------------------------------------------------------

void readLink(const Value& value, LinkConfig& link) {
  value.fields({numberField("stiffness", link.stiffness, Range::positive(1e6, "N/m")),
                numberField("damping", link.damping, Range::within(0.0, 1e4, "N s/m")),
                numberField("rotational_stiffness", link.rotational_stiffness, Range::positive(1e4, "N m/rad")),
                numberField("rotational_damping", link.rotational_damping, Range::within(0.0, 100.0, "N m s/rad")),
                numberField("peak_force", link.peak_force, Range::positive(1e6, "N")),
                numberField("peak_torque", link.peak_torque, Range::positive(1e4, "N m"))});
}

void readLimits(const Value& value, DeviceLimits& limits) {
  value.fields({numberField("peak_force", limits.peak_force, Range::positive(1000.0, "N")),
                numberField("continuous_force", limits.continuous_force, Range::positive(1000.0, "N")),
                numberField("peak_torque", limits.peak_torque, Range::within(0.0, 100.0, "N m")),
                numberField("stiffness", limits.stiffness, Range::positive(1e6, "N/m")),
                numberField("damping", limits.damping, Range::within(0.0, 1e4, "N s/m")),
                numberField("rotational_stiffness", limits.rotational_stiffness, Range::positive(1e4, "N m/rad")),
                numberField("rotational_damping", limits.rotational_damping, Range::within(0.0, 100.0, "N m s/rad")),
                numberField("workspace_radius", limits.workspace_radius, Range::positive(10.0, "m"))});
}

// Of a driver, which knows what they mean.
void readOptions(const Value& value, DeviceConfig& device) {
  std::map<std::string, std::string> values;
  for (const auto& [key, item] : value.namedEntries(100)) values[key] = item.text(4096);
  device.options = DeviceOptions(std::move(values));
  if (const auto cause = deviceObjection(device)) value.fail(*cause);
}

void readDevice(const Value& value, DeviceConfig& device) {
  value.fields(
      {choiceField("type", device.kind, deviceNames()),
       {"file",
        [&](const Value& v) {
          device.recording = FileReference{readFileName(v), "", {}};
        }},
       numberField("mass", device.mass, Range::positive(100.0, "kg")),
       numberField("inertia", device.inertia, Range::positive(100.0, "kg m^2")),
       numberField("damping", device.damping, Range::within(0.0, 1e4, "N s/m")),
       numberField("rotational_damping", device.rotational_damping, Range::within(0.0, 100.0, "N m s/rad")),
       numberField("hand_stiffness", device.hand_stiffness, Range::within(0.0, 1e6, "N/m")),
       numberField("hand_damping", device.hand_damping, Range::within(0.0, 1e4, "N s/m")),
       numberField("hand_rotational_stiffness", device.hand_rotational_stiffness, Range::within(0.0, 1e4, "N m/rad")),
       numberField("hand_rotational_damping", device.hand_rotational_damping, Range::within(0.0, 100.0, "N m s/rad")),
       {"options", [&](const Value& v) { readOptions(v, device); }},
       {"limits", [&](const Value& v) {
          DeviceLimits& limits = device.limits;
          readLimits(v, device.caps);
          readLimits(v, limits);
          if (limits.continuous_force <= limits.peak_force) return;
          v.fail(fmt::format("continuous_force {:g} N is above peak_force {:g} N", limits.continuous_force,
                             limits.peak_force));
        }}});
  const bool recorded = device.kind == DeviceName::recorded;
  if (recorded && !device.recording) value.fail("a recorded device needs a file");
  if (!recorded && device.recording) value.fail("only a recorded device has a file");
}

// Its presence turns the controller on.
void readPassivity(const Value& value, PassivitySettings& passivity) {
  passivity.enabled = true;
  value.fields({numberField("allowance", passivity.allowance, Range::within(0.0, 100.0, "J")),
                numberField("max_damping", passivity.max_damping, Range::within(0.0, 1e4, "N s/m")),
                numberField("max_rotational_damping", passivity.max_rotational_damping,
                            Range::within(0.0, 100.0, "N m s/rad"))});
}

void readSafety(const Value& value, SafetyConfig& safety) {
  PresenceSettings& presence = safety.settings.presence;
  value.fields({numberField("max_slew", safety.settings.max_slew, Range::positive(1e7, "N/s")),
                numberField("start_ramp", safety.settings.start_ramp, Range::within(0.0, 10.0, "s")),
                numberField("gap_limit", safety.settings.gap_limit, Range::positive(10.0, "s")),
                numberField("gap_ramp", safety.settings.gap_ramp, Range::within(0.0, 10.0, "s")),
                numberField("model_age_limit", safety.model_age_limit, Range::positive(10.0, "s")),
                {"dead_man", [&](const Value& item) { presence.dead_man = static_cast<int>(item.integer(0, 32)); }},
                {"start_gate", [&](const Value& item) { safety.start_gate = presence.start_gate = item.boolean(); }},
                numberField("workspace", presence.workspace, Range::positive(10.0, "m")),
                numberField("frozen_limit", presence.frozen_limit, Range::positive(10.0, "s")),
                {"stop_swings", [&](const Value& item) { safety.settings.oscillation.enabled = item.boolean(); }},
                {"passivity", [&](const Value& item) { readPassivity(item, safety.settings.passivity); }}});
}

// The scene
// ------------------------------------------------------------------------------------------------------------

/// Tool, bodies and obstacles share one set of names.
class NameRegister {
 public:
  void take(const Value& value, const std::string& name) {
    if (!taken_.insert(name).second) value.fail(fmt::format("the name \"{}\" is given twice", name));
  }

 private:
  std::set<std::string> taken_{"tool"};
};

void readSubsteps(const Value& value, SceneConfig& config) {
  const std::optional<int> substeps = value.integerOr("auto", 1, kMaxSubsteps);
  config.substeps_auto = !substeps;
  config.substeps = substeps.value_or(config.substeps);
}

void readVisualStep(const Value& value, SceneConfig& config) {
  const std::optional<double> step = value.numberOr("auto", limits::kVisualStep);
  config.visual_step_auto = !step;
  config.visual_step = step.value_or(config.visual_step);
}

void readLive(const Value& value, LiveSettings& live) {
  value.fields({integerField("modes", live.modes, 0, LiveSize::kToolModes),
                integerField("partner_modes", live.partner_modes, 0, LiveSize::kPartnerModes),
                integerField("contacts", live.contacts, 1, LiveSize::kContacts),
                integerField("second_order", live.second_order, 0, LiveSize::kSecond),
                numberField("horizon", live.horizon, Range::positive(10.0, "s")),
                numberField("margin", live.margin, Range::positive(1.0, "m")),
                numberField("lookahead", live.lookahead, Range::within(0.0, 10.0, "s")),
                numberField("feedback", live.feedback, Range::within(0.0, 1.0, "")),
                numberField("bend", live.bend, Range::within(0.0, 1.0, ""))});
}

std::vector<Field> runFields(SceneConfig& config, bool& method_given) {
  const auto readVisual = [&config](const Value& value) {
    value.fields({required({"step", [&config](const Value& v) { readVisualStep(v, config); }}),
                  {"substeps", [&config](const Value& v) { readSubsteps(v, config); }},
                  numberField("budget", config.visual_budget, Range::positive(1000.0, "s"))});
  };
  const auto readHaptic = [&config](const Value& value) {
    value.fields({required(numberField("step", config.haptic_step, limits::kHapticStep))});
  };
  const auto readView = [&config](const Value& value) {
    value.fields({required(directionField("from", config.view_from.emplace()))});
  };
  return {numberField("duration", config.duration, limits::kDuration),
          {"visual", readVisual},
          {"haptic", readHaptic},
          integerField("latency", config.latency, 0, limits::kLatency),
          integerField("jitter", config.jitter, 0, limits::kLatency),
          {"method",
           [&config, &method_given](const Value& value) {
             method_given = true;
             config.method = static_cast<MethodName>(value.choice(methodNames()));
           }},
          choiceField("aim", config.aim, aimNames()),
          booleanField("weight_compensation", config.weight_compensation),
          {"seed", [&config](const Value& value) { config.seed = value.seed(); }},
          {"view", readView},
          {"live", [&config](const Value& value) { readLive(value, config.live); }},
          {"linearization", [&config](const Value& value) {
             value.fields({choiceField("derivative", config.derivative, derivativeNames())});
           }}};
}

std::vector<Field> worldFields(SceneConfig& config, NameRegister& names) {
  const auto readBodies = [&](const Value& list) {
    for (const Value& item : list.items(kMaxBodies)) {
      config.bodies.push_back(readFreeBody(item, config.bodies.size()));
      names.take(item, config.bodies.back().name);
    }
  };
  const auto readObstacles = [&](const Value& list) {
    for (const Value& item : list.items(kMaxObstacles)) {
      config.obstacles.push_back(readObstacle(item, config.obstacles.size()));
      names.take(item, config.obstacles.back().name);
    }
  };
  return {vectorField("gravity", config.gravity, Range::within(-1000.0, 1000.0, "m/s^2")),
          required({"tool", [&config](const Value& value) { readTool(value, config.tool); }}),
          {"bodies", readBodies},
          {"obstacles", readObstacles},
          {"contact", [&config](const Value& value) { readContact(value, config, config.contact); }},
          {"device",
           [&config](const Value& value) {
             readDevice(value, config.device);
             config.link = linkForDevice(config.device.limits);
           }},
          {"link",
           [&config](const Value& value) {
             readLink(value, config.link_given);
             config.link = config.link_given.over(config.link);
           }},  // after what it defaults to
          {"safety", [&config](const Value& value) { readSafety(value, config.safety); }}};
}

void readVersion(const Value& value) {
  if (value.describes()) return static_cast<void>(value.integer(kSchemaVersion, kSchemaVersion));
  const int version = value.integer(0, 1000000);
  if (version != kSchemaVersion)
    value.fail(fmt::format("schema version {} is not known; this program reads version {}", version, kSchemaVersion));
}

void readRoot(const Value& root, SceneConfig& config) {
  NameRegister names;
  std::vector<Field> fields{required({"palpate", readVersion}),
                            required(nameField(config.name)),
                            {"description", [&](const Value& v) { config.description = v.text(10000); }}};
  bool method_given = false;
  for (Field& field : runFields(config, method_given)) fields.push_back(std::move(field));
  for (Field& field : worldFields(config, names)) fields.push_back(std::move(field));
  root.fields(fields);
  if (!method_given && methodObjection(config)) config.method = MethodName::hsl;
}

}  // namespace

SceneConfig readSceneFromString(std::string_view text, const std::string& name) {
  return readSceneFromDocument(parseDocument(text, name), name);
}

SceneConfig readSceneFromDocument(DocumentNode::Pointer document, const std::string& name) {
  SceneConfig config;
  config.source = std::move(document);
  readRoot(Value(name, "", config.source), config);
  if (const auto cause = stepObjection(config)) throw InputError(name, "visual.step", *cause);
  if (const auto cause = timingObjection(config)) throw InputError(name, "duration", *cause);
  if (const auto cause = sizeObjection(config)) throw InputError(name, "", *cause);
  if (const auto cause = methodObjection(config)) throw InputError(name, "method", *cause);
  return config;
}

nlohmann::ordered_json sceneSchema() {
  nlohmann::ordered_json schema = Value::schemaOf([](const Value& root) {
    SceneConfig config;
    readRoot(root, config);
  });
  return finishedSchema(std::move(schema), "Scene of Palpate, version 1");
}

SceneConfig readScene(const std::filesystem::path& file) {
  SceneConfig config = readSceneFromString(readDocumentText(file), file.string());
  config.file = file;
  resolveFiles(config);
  return config;
}

}  // namespace palpate
