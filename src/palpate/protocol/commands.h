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
/// How a dropped surface becomes the tool. Its rest coordinates: scaled to `size`, centered over the origin, its lowest
/// point at z = 0, not turned.
struct PlaceMessage {
  /// What the hand holds: the uppermost quarter as it stands turned, a box, or what a brush has touched.
  enum class Handle { top, box, painted };
  double size = 0.15;                ///< longest side [m]
  Quat rotation = Quat::Identity();  ///< how it stands
  int tetrahedra = 600;              ///< wanted
  Handle handle = Handle::top;
  Vec3 min = Vec3::Zero();  ///< of the box, rest coordinates [m]
  Vec3 max = Vec3::Zero();
  std::vector<Vec3> centers;  ///< of the brush, rest coordinates [m]
  double radius = 0.0;        ///< of the brush [m]
};
struct CancelMessage {};
struct SaveMessage {};
using ViewerCommand =
    std::variant<HandMessage, TakeMessage, ReleaseMessage, PlayMessage, SetMessage, PauseMessage, ResumeMessage,
                 StepMessage, ResetMessage, SceneMessage, RecordMessage, PlaceMessage, CancelMessage, SaveMessage>;

/// Reads one message; all numbers in it are finite and in range (protocol/layout.h).
/// @throws InputError ("message", key, cause)
ViewerCommand parseCommand(std::string_view json);

/// All that parseCommand() knows, and the keys of `set`.
std::vector<std::string> commandNames();
std::vector<std::string> settingNames();

}  // namespace palpate
