#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// How a force is spelled: {"set_cursor_force": {"values": ...}} up to version 3.4 of the service, "vector" from 3.5
/// on.
enum class ForceSpelling { values, vector };

/// A device in the service's first message, or in one that was asked for.
struct Inverse3Entry {
  std::string id;
  std::string type;  ///< "inverse3", "minverse" ...; empty: not said
  // What is not said counts as good: it is the state's to tell.
  bool calibrated = true, in_use = false, powered = true, ready = true, started = true;
  std::vector<std::pair<std::string, std::string>> facts;  ///< what changes forces, and versions
};

struct Inverse3Inventory {
  std::vector<Inverse3Entry> devices;
  std::string grip;  ///< kind of the first grip: "verse_grip", "wireless_verse_grip", "custom_verse_grip"; empty: none
};

/// @returns none for what is no JSON object, or has no list of devices: older formats. Unknown fields are left alone.
std::optional<Inverse3Inventory> readInverse3Inventory(std::string_view text);

/// State of one device and its grip, as the service has it: m, m/s, N; right-handed, +X right, +Y forward, +Z up.
struct Inverse3State {
  std::string id;
  Vec3 position = Vec3::Zero();
  Vec3 velocity = Vec3::Zero();
  Vec3 force = Vec3::Zero();         ///< that the device says it renders
  Quat rotation = Quat::Identity();  ///< of the grip
  std::uint32_t buttons = 0;
  bool calibrated = true, in_use = false, powered = true, ready = true, started = true;
};

enum class Inverse3Answer {
  state,    ///< the state is renewed; what the message leaves out stays as it was
  other,    ///< there are devices, but not this one
  nobody,   ///< no device at all
  garbage,  ///< no JSON object, or one without a position; the state is as before
};

/// @param id  of the device, or empty: the only one
Inverse3Answer readInverse3State(std::string_view text, const std::string& id, Inverse3State& state);

/// One message with a force [N] for a device.
/// @param session  a "session" object to go with it, or empty
std::string inverse3Force(const std::string& id, const Vec3& force, ForceSpelling spelling,
                          const std::string& session = {}, const std::string& configure = {});

/// Text as a JSON string, with its quotation marks.
std::string jsonText(const std::string& text);

/// Of an event of the service.
struct Inverse3Event {
  std::string name, level, device, safety, message;
};
std::optional<Inverse3Event> readInverse3Event(std::string_view text);

/// The version in the answer to GET /version, e.g. "3.5.0"; empty: none.
std::string readServiceVersion(std::string_view body);
/// From 3.5 on.
ForceSpelling spellingOf(const std::string& version);

}  // namespace palpate
