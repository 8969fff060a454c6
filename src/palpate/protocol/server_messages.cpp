#include "palpate/protocol/server_messages.h"

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>

#include "palpate/protocol/layout.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

// Names may hold bytes that are no UTF-8: they are replaced.
std::string dump(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

}  // namespace

std::string welcomeMessage(int viewer, const std::string& version) {
  return dump({{"type", "welcome"}, {"protocol", protocol::kVersion}, {"viewer", viewer}, {"version", version}});
}

std::string sessionMessage(const Session& session) {
  return dump({{"mode", session.mode},
               {"protocol", protocol::kVersion},
               {"version", session.version},
               {"name", session.name},
               {"max_surface_bytes", session.max_surface_bytes}});
}

std::optional<unsigned> acknowledgedStep(std::string_view message) {
  if (message.find("\"ack\"") == std::string_view::npos) return std::nullopt;  // spares most messages the parser
  const auto json = nlohmann::json::parse(message, nullptr, false);
  if (!json.is_object()) return std::nullopt;
  const auto type = json.find("type"), frame = json.find("frame");
  if (type == json.end() || *type != "ack" || frame == json.end() || !frame->is_number_unsigned()) return std::nullopt;
  const auto step = frame->get<std::uint64_t>();
  return step <= std::numeric_limits<unsigned>::max() ? std::optional(static_cast<unsigned>(step)) : std::nullopt;
}

}  // namespace palpate
