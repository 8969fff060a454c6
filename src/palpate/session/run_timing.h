#pragma once

#include <cstdint>

#include "palpate/haptics/device_state.h"
#include "palpate/scene/builder.h"
#include "palpate/scene/config.h"
#include "palpate/visual/visual_step.h"

namespace palpate {

/// Timing of a run, from the scene's settings.
struct RunTiming {
  double duration = 10;
  double haptic_step = 0.001;
  double visual_step = 0.033;
  int latency = 1;
  int jitter = 0;          ///< a result comes up to so many visual steps later than by `latency` ...
  std::uint64_t seed = 1;  ///< ... by chance
  bool predicted_aim = false;
  int substeps = 1;            ///< parts in which a visual step is taken
  bool substeps_auto = false;  ///< in real time as many as fit the visual step; in lockstep `substeps`
};
RunTiming timingOf(const SceneConfig& config);

/// Ticks by which the result of the visual step of a tick is late: evenly spread over 0 to `jitter` visual steps, and
/// the same for the same seed and tick.
std::int64_t delayTicks(const RunTiming& timing, std::int64_t tick);

/// What the visual handle aims at, from a device sample.
DeviceTarget aimAt(const DeviceState& device, const RunTiming& timing);

inline bool isLive(const BuiltScene& scene) { return scene.haptic.rendering == Rendering::live; }

/// What the run's visual steps are taken with.
VisualStepSettings visualSettings(const BuiltScene& scene, const RunTiming& timing);

/// Model of the present state at rest, for the start of a run. @throws RunError if the step that it takes fails
HandleModel startModel(BuiltScene& scene, const RunTiming& timing);

/// Puts haptic loop and device to the start of a run. @returns the wrench that the hand carries at first
Vec6 startHaptics(BuiltScene& scene, HapticLoop& loop);

}  // namespace palpate
