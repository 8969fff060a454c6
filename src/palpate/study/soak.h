#pragma once

#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "palpate/haptics/realtime.h"
#include "palpate/scene/config.h"
#include "palpate/session/run_record.h"

namespace palpate {

/// A scene in real time for long, in random hands.
struct SoakSettings {
  double duration = 3600;     ///< [s]
  double hand_time = 20;      ///< after which another hand takes the device [s]
  double memory_limit = 1.0;  ///< steady growth of what the process has in memory, in the whole run [MiB]
  double early_limit = 8.0;   ///< the same in less than ten minutes, while workspaces still find their size [MiB]
};

/// How a soak went.
struct SoakOutcome {
  RunOutcome run;
  double duration = 0;           ///< [s]
  std::uint64_t not_finite = 0;  ///< ticks and steps with a number that is none, or a state that had to be put back
  std::uint64_t steps = 0;
  /// Of resident memory behind the first fifth of the run: ten times the median increment from one tenth of it to the
  /// next. A leak is in all of them; a step harder than any before, for which tables grow once, is in one.
  double memory_growth = 0;           // [MiB]
  double memory_peak = 0;             ///< [MiB]
  std::vector<double> memory;         ///< at twenty moments, evenly spread [MiB]
  int hands = 0;                      ///< that have held the device
  double peak_force = 0;              ///< sent [N]
  std::vector<std::string> failures;  ///< for people; empty: it held
};

/// The scene's motion replaced by a random one for so long: from rest to rest, within the box that its keyframes span
/// in position and rotation, at up to 0.2 m/s and 3 rad/s; the same for the same seed.
SceneConfig withRandomMotion(SceneConfig config, double duration);

/// @param progress  returns false to end early
/// @throws InputError for a scene whose hand has no keyframes; RunError if the first step fails
SoakOutcome runSoak(const SceneConfig& config, const SoakSettings& settings,
                    const std::function<bool(double)>& progress);

/// For summary.json.
nlohmann::ordered_json soakJson(const std::string& scene, const SoakOutcome& outcome);

}  // namespace palpate
