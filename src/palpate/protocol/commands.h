#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

// What a page may ask for (docs/viewer.md, "Page to server").

struct HandMessage {
  std::uint32_t sequence = 0;
  Pose pose;  ///< where the hand wants the device, world
};
struct TakeMessage {};
struct ReleaseMessage {};
struct PlayMessage {};
struct SetMessage {
  std::optional<std::string> method, handle;
  std::optional<double> visual_step;  ///< [s]
  std::optional<double> friction, stiffness, speed;
  std::optional<bool> stress;
};
struct PauseMessage {};
struct ResumeMessage {};
struct StepMessage {};
struct ResetMessage {};
struct SceneMessage {
  std::string name;
};
struct RecordMessage {
  bool on = false;
};
using ViewerCommand = std::variant<HandMessage, TakeMessage, ReleaseMessage, PlayMessage, SetMessage, PauseMessage,
                                   ResumeMessage, StepMessage, ResetMessage, SceneMessage, RecordMessage>;

/// Reads one message; all numbers in it are finite and in range (protocol/layout.h).
/// @throws InputError ("message", key, cause)
ViewerCommand parseCommand(std::string_view json);

/// All that parseCommand() knows, and the keys of `set`.
std::vector<std::string> commandNames();
std::vector<std::string> settingNames();

}  // namespace palpate
