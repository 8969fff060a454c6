#include "palpate/devices/inverse3_messages.h"

#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <nlohmann/json.hpp>

namespace palpate {
namespace {

using nlohmann::json;

constexpr std::array<const char*, 3> kGrips{"verse_grip", "wireless_verse_grip", "custom_verse_grip"};

// The service leaves fields out, writes 0 for 0.0, and adds new ones: nothing is taken for granted.
const json& at(const json& value, const char* key) {
  static const json kNothing;
  if (!value.is_object()) return kNothing;
  const auto found = value.find(key);
  return found == value.end() ? kNothing : *found;
}
double number(const json& value, const char* key, double otherwise) {
  const json& found = at(value, key);
  return found.is_number() ? found.get<double>() : otherwise;
}
bool flag(const json& value, const char* key, bool otherwise) {
  const json& found = at(value, key);
  return found.is_boolean() ? found.get<bool>() : otherwise;
}
std::string text(const json& value, const char* key) {
  const json& found = at(value, key);
  if (found.is_string()) return found.get<std::string>().substr(0, 200);
  return found.is_number() || found.is_boolean() ? found.dump() : std::string();
}
Vec3 vector(const json& value, const Vec3& otherwise) {
  return {number(value, "x", otherwise.x()), number(value, "y", otherwise.y()), number(value, "z", otherwise.z())};
}

json parse(std::string_view message) {
  json out = json::parse(message.begin(), message.end(), nullptr, false);
  return out.is_object() ? out : json();
}

template <typename Target>
void readStatus(const json& status, Target& out) {
  out.calibrated = flag(status, "calibrated", out.calibrated);
  out.in_use = flag(status, "in_use", out.in_use);
  out.powered = flag(status, "power_supply", out.powered);
  out.ready = flag(status, "ready", out.ready);
  out.started = flag(status, "started", out.started);
}

void addFact(Inverse3Entry& entry, const char* name, const std::string& value) {
  if (!value.empty()) entry.facts.emplace_back(name, value);
}

Inverse3Entry entryOf(const json& device) {
  Inverse3Entry out;
  out.id = text(device, "device_id");
  const json& config = at(device, "config");
  out.type = text(config, "type");
  readStatus(at(device, "status"), out);
  const json& about = at(config, "device_info");
  addFact(out, "type", out.type);
  if (const std::string major = text(about, "major_version"); !major.empty()) {
    addFact(out, "hardware", major + "." + text(about, "minor_version"));
  }
  addFact(out, "firmware", text(config, "extended_firmware_version"));
  addFact(out, "handedness", text(config, "handedness"));
  const json& preset = at(config, "preset");
  addFact(out, "preset", preset.is_object() ? text(preset, "preset") : text(config, "preset"));
  addFact(out, "basis", text(at(config, "basis"), "permutation"));
  const json& gravity = at(config, "gravity_compensation");
  addFact(out, "gravity compensation", text(gravity, "enabled"));
  addFact(out, "gravity compensation, factor", text(gravity, "scaling_factor"));
  addFact(out, "torque scaling", text(at(config, "torque_scaling"), "enabled"));
  addFact(out, "home return", text(at(config, "home_return"), "enabled"));
  const json& filters = at(config, "filters");
  addFact(out, "force gate, gain", text(at(filters, "force_gate"), "gain"));
  addFact(out, "damping filter", text(at(filters, "damping"), "scalar"));
  return out;
}

const json& firstGrip(const json& message, std::string* kind = nullptr) {
  static const json kNothing;
  for (const char* name : kGrips) {
    const json& grips = at(message, name);
    if (!grips.is_array() || grips.empty()) continue;
    if (kind) *kind = name;
    return grips[0];
  }
  return kNothing;
}

void readGrip(const json& grip, Inverse3State& out) {
  const json& state = at(grip, "state");
  if (!state.is_object()) return;
  const json& q = at(state, "orientation");
  const Quat& before = out.rotation;
  const Quat read(number(q, "w", before.w()), number(q, "x", before.x()), number(q, "y", before.y()),
                  number(q, "z", before.z()));
  if (read.norm() > 0.5 && read.norm() < 2.0) out.rotation = read.normalized();
  const json& buttons = at(state, "buttons");
  if (buttons.is_object()) {
    out.buttons = (flag(buttons, "a", false) ? 1u : 0u) | (flag(buttons, "b", false) ? 2u : 0u) |
                  (flag(buttons, "c", false) ? 4u : 0u);
  } else {
    out.buttons = flag(state, "button", false) ? 1u : 0u;
  }
}

}  // namespace

std::optional<Inverse3Inventory> readInverse3Inventory(std::string_view message) {
  const json root = parse(message);
  if (!root.is_object()) return std::nullopt;
  Inverse3Inventory out;
  const json& devices = at(root, "inverse3");
  if (!devices.is_array() && !root.contains("session_id")) return std::nullopt;
  if (devices.is_array()) {
    for (const json& device : devices) out.devices.push_back(entryOf(device));
  }
  firstGrip(root, &out.grip);
  return out;
}

Inverse3Answer readInverse3State(std::string_view message, const std::string& id, Inverse3State& state) {
  const json root = parse(message);
  if (!root.is_object()) return Inverse3Answer::garbage;
  const json& devices = at(root, "inverse3");
  if (!devices.is_array() || devices.empty()) return Inverse3Answer::nobody;
  const json* mine = nullptr;
  for (const json& device : devices) {
    if (id.empty() || text(device, "device_id") == id) mine = &device;
  }
  if (mine == nullptr) return Inverse3Answer::other;
  const json& now = at(*mine, "state");
  const json& position = at(now, "cursor_position");
  if (!position.is_object()) return Inverse3Answer::garbage;
  state.id = text(*mine, "device_id");
  state.position = vector(position, state.position);
  state.velocity = vector(at(now, "cursor_velocity"), state.velocity);
  state.force = vector(at(now, "current_cursor_force"), state.force);
  readStatus(at(*mine, "status"), state);
  readGrip(firstGrip(root), state);
  return Inverse3Answer::state;
}

std::string jsonText(const std::string& value) {
  return json(value).dump(-1, ' ', true, json::error_handler_t::replace);
}

std::string inverse3Force(const std::string& id, const Vec3& force, ForceSpelling spelling, const std::string& session,
                          const std::string& configure) {
  // shortest text that gives the same number back, with a point in any locale
  return fmt::format(
      R"({{{}"inverse3":[{{"device_id":{},{}"commands":{{"set_cursor_force":{{"{}":{{"x":{},"y":{},"z":{}}}}}}}}}]}})",
      session.empty() ? "" : "\"session\":" + session + ",", jsonText(id),
      configure.empty() ? "" : "\"configure\":" + configure + ",",
      spelling == ForceSpelling::vector ? "vector" : "values", force.x(), force.y(), force.z());
}

std::optional<Inverse3Event> readInverse3Event(std::string_view message) {
  const json root = parse(message);
  if (!root.is_object()) return std::nullopt;
  const json& data = at(root, "data");
  return Inverse3Event{text(root, "name"), text(root, "level"), text(data, "device_id"), text(data, "safety_type"),
                       text(root, "message")};
}

std::string readServiceVersion(std::string_view body) {
  const json root = parse(body);
  const std::string inner = text(at(root, "data"), "project_version");
  return inner.empty() ? text(root, "project_version") : inner;
}

ForceSpelling spellingOf(const std::string& version) {
  char* end = nullptr;
  const long major = std::strtol(version.c_str(), &end, 10);
  const long minor = *end == '.' ? std::strtol(end + 1, nullptr, 10) : 0;
  return major > 3 || (major == 3 && minor >= 5) ? ForceSpelling::vector : ForceSpelling::values;
}

}  // namespace palpate
