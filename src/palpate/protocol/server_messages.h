#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

// The messages that are the server's own, whatever runs behind it (docs/viewer.md). They need no other room.

/// JSON `welcome`, the first that a viewer gets.
std::string welcomeMessage(int viewer, const std::string& version);

/// `GET /session.json`.
struct Session {
  std::string mode;  ///< "view" or "replay"
  std::string version;
  std::string name;  ///< of the scene or the recording
  std::size_t max_surface_bytes = 0;
};
std::string sessionMessage(const Session& session);

/// `frame` of an `ack` message; nothing where the text is anything else. Never throws.
std::optional<unsigned> acknowledgedStep(std::string_view message);

}  // namespace palpate
