#include "palpate/protocol/description.h"

#include <nlohmann/json.hpp>

#include "palpate/protocol/commands.h"
#include "palpate/protocol/layout.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

template <std::size_t N>
Json row(const std::array<protocol::Column, N>& columns) {
  Json offsets = Json::object();
  std::size_t at = 0;
  for (const protocol::Column& column : columns) {
    offsets[column.name] = at;
    at += column.width;
  }
  return {{"stride", at}, {"columns", offsets}};
}

Json range(const protocol::Limits& limits) { return {limits.low, limits.high}; }

}  // namespace

std::string protocolDescription() {
  using namespace protocol;
  Json out;
  out["version"] = kVersion;
  out["kinds"] = {{"geometry", Kind::geometry}, {"frame", Kind::frame}, {"samples", Kind::samples}};
  out["body_flags"] = {{"tool", kToolBody}, {"rigid", kRigidBody}};
  out["obstacles"] = {{"plane", ObstacleKind::plane}, {"surface", ObstacleKind::surface}};
  out["contact_states"] = {
      {"open", ContactKind::open}, {"sticking", ContactKind::sticking}, {"sliding", ContactKind::sliding}};
  out["contact"] = row(kContactColumns);
  out["tick"] = row(kTickColumns);
  out["step"] = row(kStepColumns);
  out["recording"] = {{"magic", kRecordingMagic},
                      {"alignment", kRecordAlignment},
                      {"text", RecordKind::text},
                      {"binary", RecordKind::binary},
                      {"extra", RecordKind::extra}};
  out["commands"] = commandNames();
  out["settings"] = settingNames();
  out["limits"] = {{"visual_step", range(kVisualStep)},
                   {"friction", range(kFriction)},
                   {"stiffness", range(kStiffness)},
                   {"speed", range(kSpeed)},
                   {"farthest", kFarthest},
                   {"command_bytes", kMaxCommandBytes},
                   {"text_bytes", kMaxTextBytes},
                   {"surface_size", range(kSurfaceSize)},
                   {"tetrahedra", range(kTetrahedra)},
                   {"brush", range(kBrush)},
                   {"dabs", kMostDabs},
                   {"surface_bytes", kMaxSurfaceBytes}};
  return out.dump(2) + "\n";
}

}  // namespace palpate
