#pragma once

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
  bool predicted_aim = false;
  int substeps = 1;            ///< parts in which a visual step is taken
  bool substeps_auto = false;  ///< in real time as many as fit the visual step; in lockstep `substeps`
};
RunTiming timingOf(const SceneConfig& config);

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
