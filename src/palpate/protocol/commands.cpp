#include "palpate/protocol/commands.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "palpate/common/error.h"
#include "palpate/protocol/layout.h"

namespace palpate {
namespace {

using Json = nlohmann::json;

[[noreturn]] void refuse(const std::string& key, const std::string& cause) { throw InputError("message", key, cause); }

const Json& member(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end()) refuse(key, "is missing");
  return *found;
}

double number(const Json& json, const char* key, const protocol::Limits& limits) {
  const double value = json.is_number() ? json.get<double>() : std::nan("");
  if (!(value >= limits.low && value <= limits.high))
    refuse(key, fmt::format("must be a number from {} to {}", limits.low, limits.high));
  return value;
}

std::string text(const Json& json, const char* key) {
  if (!json.is_string() || json.get_ref<const std::string&>().size() > protocol::kMaxTextBytes)
    refuse(key, "must be a short text");
  return json.get<std::string>();
}

bool flag(const Json& json, const char* key) {
  if (!json.is_boolean()) refuse(key, "must be true or false");
  return json.get<bool>();
}

template <int N>
Eigen::Matrix<double, N, 1> vector(const Json& json, const char* key, double limit) {
  if (!json.is_array() || json.size() != N) refuse(key, fmt::format("must be {} numbers", N));
  Eigen::Matrix<double, N, 1> out;
  for (int k = 0; k < N; ++k) out[k] = number(json[static_cast<std::size_t>(k)], key, {-limit, limit});
  return out;
}

Quat unitQuaternion(const Json& json, const char* key) {
  const auto q = vector<4>(json, key, 2.0);
  if (q.norm() < 0.5 || q.norm() > 2.0) refuse(key, "must be a unit quaternion w x y z");
  return Quat(q[0], q[1], q[2], q[3]).normalized();
}

HandMessage hand(const Json& json) {
  HandMessage out;
  out.sequence = static_cast<std::uint32_t>(number(member(json, "seq"), "seq", {0, 4294967295.0}));
  out.pose.position = vector<3>(member(json, "position"), "position", protocol::kFarthest);
  out.pose.rotation = unitQuaternion(member(json, "rotation"), "rotation");
  return out;
}

PlaceMessage::Handle handleKind(const Json& json) {
  const std::string name = text(json, "handle");
  if (name == "top") return PlaceMessage::Handle::top;
  if (name == "box") return PlaceMessage::Handle::box;
  if (name != "painted") refuse("handle", "must be top, box or painted");
  return PlaceMessage::Handle::painted;
}

// x, y, z of one after the other: a message is not to be deep.
std::vector<Vec3> points(const Json& json, const char* key) {
  if (!json.is_array() || json.empty() || json.size() % 3 != 0 || json.size() > 3 * protocol::kMostDabs)
    refuse(key, fmt::format("must be three numbers each for 1 to {} points", protocol::kMostDabs));
  std::vector<Vec3> out(json.size() / 3);
  for (std::size_t i = 0; i < json.size(); ++i)
    out[i / 3][static_cast<Eigen::Index>(i % 3)] = number(json[i], key, {-protocol::kFarthest, protocol::kFarthest});
  return out;
}

void placeBox(const Json& json, PlaceMessage& out) {
  out.min = vector<3>(member(json, "min"), "min", protocol::kFarthest);
  out.max = vector<3>(member(json, "max"), "max", protocol::kFarthest);
  if ((out.min.array() > out.max.array()).any()) refuse("min", "must not be above max");
}

PlaceMessage place(const Json& json) {
  using Handle = PlaceMessage::Handle;
  PlaceMessage out;
  out.size = number(member(json, "size"), "size", protocol::kSurfaceSize);
  out.rotation = unitQuaternion(member(json, "rotation"), "rotation");
  const double count = number(member(json, "tetrahedra"), "tetrahedra", protocol::kTetrahedra);
  if (count != std::floor(count)) refuse("tetrahedra", "must be a whole number");
  out.tetrahedra = static_cast<int>(count);
  out.handle = handleKind(member(json, "handle"));
  if (out.handle == Handle::box) placeBox(json, out);
  if (out.handle == Handle::painted) {
    out.centers = points(member(json, "centers"), "centers");
    out.radius = number(member(json, "radius"), "radius", protocol::kBrush);
  }
  const std::size_t keys = out.handle == Handle::top ? 5 : 7;
  if (json.size() != keys) refuse("place", "has keys that do not belong to it");
  return out;
}

struct Setting {
  const char* name;
  void (*read)(const Json& value, SetMessage& out);
};
constexpr std::array kSettings{
    Setting{"method", [](const Json& v, SetMessage& out) { out.method = text(v, "method"); }},
    Setting{"handle", [](const Json& v, SetMessage& out) { out.handle = text(v, "handle"); }},
    Setting{"visual_step",
            [](const Json& v, SetMessage& out) { out.visual_step = number(v, "visual_step", protocol::kVisualStep); }},
    Setting{"friction",
            [](const Json& v, SetMessage& out) { out.friction = number(v, "friction", protocol::kFriction); }},
    Setting{"stiffness",
            [](const Json& v, SetMessage& out) { out.stiffness = number(v, "stiffness", protocol::kStiffness); }},
    Setting{"speed", [](const Json& v, SetMessage& out) { out.speed = number(v, "speed", protocol::kSpeed); }},
    Setting{"stress", [](const Json& v, SetMessage& out) { out.stress = flag(v, "stress"); }},
};

SetMessage settings(const Json& json) {
  SetMessage out;
  for (const auto& [key, value] : json.items()) {
    if (key == "type") continue;
    const auto setting =
        std::find_if(kSettings.begin(), kSettings.end(), [&name = key](const Setting& s) { return name == s.name; });
    if (setting == kSettings.end()) refuse(key.substr(0, protocol::kMaxTextBytes), "is no setting");
    setting->read(value, out);
  }
  return out;
}

struct Command {
  const char* name;
  ViewerCommand (*read)(const Json& message);
};
template <class Message>
ViewerCommand plain(const Json&) {
  return Message{};
}
constexpr std::array kCommands{
    Command{"hand", [](const Json& m) -> ViewerCommand { return hand(m); }},
    Command{"take", plain<TakeMessage>},
    Command{"release", plain<ReleaseMessage>},
    Command{"play", plain<PlayMessage>},
    Command{"set", [](const Json& m) -> ViewerCommand { return settings(m); }},
    Command{"pause", plain<PauseMessage>},
    Command{"resume", plain<ResumeMessage>},
    Command{"step", plain<StepMessage>},
    Command{"reset", plain<ResetMessage>},
    Command{"scene", [](const Json& m) -> ViewerCommand { return SceneMessage{text(member(m, "name"), "name")}; }},
    Command{"record", [](const Json& m) -> ViewerCommand { return RecordMessage{flag(member(m, "on"), "on")}; }},
    Command{"place", [](const Json& m) -> ViewerCommand { return place(m); }},
    Command{"cancel", plain<CancelMessage>},
    Command{"save", plain<SaveMessage>},
};

template <class Table>
std::vector<std::string> namesOf(const Table& table) {
  std::vector<std::string> out;
  for (const auto& entry : table) out.emplace_back(entry.name);
  return out;
}

// A parser that goes no deeper than any message does.
Json parse(std::string_view json) {
  constexpr int kDepth = 4;
  const auto shallow = [](int depth, Json::parse_event_t, Json&) { return depth <= kDepth; };
  Json out = Json::parse(json, shallow, false);
  if (!out.is_object()) refuse("", "must be a JSON object");
  return out;
}

}  // namespace

ViewerCommand parseCommand(std::string_view json) {
  const Json message = parse(json);
  const std::string type = text(member(message, "type"), "type");
  for (const Command& command : kCommands) {
    if (type == command.name) return command.read(message);
  }
  refuse("type", "'" + type + "' is none of the known ones");
}

std::vector<std::string> commandNames() { return namesOf(kCommands); }
std::vector<std::string> settingNames() { return namesOf(kSettings); }

}  // namespace palpate
