#include "palpate/protocol/commands.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "palpate/common/error.h"

namespace palpate {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostText = 200;
constexpr double kFarthest = 100.0;  // [m]

[[noreturn]] void refuse(const std::string& key, const std::string& cause) { throw InputError("message", key, cause); }

const Json& member(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end()) refuse(key, "is missing");
  return *found;
}

double number(const Json& json, const char* key, double low, double high) {
  const double value = json.is_number() ? json.get<double>() : std::nan("");
  if (!(value >= low && value <= high)) refuse(key, fmt::format("must be a number from {} to {}", low, high));
  return value;
}

std::string text(const Json& json, const char* key) {
  if (!json.is_string() || json.get_ref<const std::string&>().size() > kMostText) refuse(key, "must be a short text");
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
  for (int k = 0; k < N; ++k) out[k] = number(json[static_cast<std::size_t>(k)], key, -limit, limit);
  return out;
}

HandMessage hand(const Json& json) {
  HandMessage out;
  out.sequence = static_cast<std::uint32_t>(number(member(json, "seq"), "seq", 0, 4294967295.0));
  out.pose.position = vector<3>(member(json, "position"), "position", kFarthest);
  const auto q = vector<4>(member(json, "rotation"), "rotation", 2.0);
  if (q.norm() < 0.5 || q.norm() > 2.0) refuse("rotation", "must be a unit quaternion w x y z");
  out.pose.rotation = Quat(q[0], q[1], q[2], q[3]).normalized();
  return out;
}

SetMessage settings(const Json& json) {
  SetMessage out;
  for (const auto& [key, value] : json.items()) {
    if (key == "type") continue;
    if (key == "method") {
      out.method = text(value, "method");
    } else if (key == "handle") {
      out.handle = text(value, "handle");
    } else if (key == "visual_step") {
      out.visual_step = number(value, "visual_step", kMinVisualStep, kMaxVisualStep);
    } else if (key == "friction") {
      out.friction = number(value, "friction", 0.0, kMaxFriction);
    } else if (key == "stiffness") {
      out.stiffness = number(value, "stiffness", kMinStiffness, kMaxStiffness);
    } else if (key == "speed") {
      out.speed = number(value, "speed", kMinSpeed, kMaxSpeed);
    } else if (key == "stress") {
      out.stress = flag(value, "stress");
    } else {
      refuse(key.substr(0, kMostText), "is no setting");
    }
  }
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
  if (type == "hand") return hand(message);
  if (type == "take") return TakeMessage{};
  if (type == "release") return ReleaseMessage{};
  if (type == "play") return PlayMessage{};
  if (type == "set") return settings(message);
  if (type == "pause") return PauseMessage{};
  if (type == "resume") return ResumeMessage{};
  if (type == "step") return StepMessage{};
  if (type == "reset") return ResetMessage{};
  if (type == "scene") return SceneMessage{text(member(message, "name"), "name")};
  if (type == "record") return RecordMessage{flag(member(message, "on"), "on")};
  refuse("type", "'" + type + "' is none of the known ones");
}

}  // namespace palpate
