#include "palpate/session/run_timing.h"

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"

namespace palpate {

RunTiming timingOf(const SceneConfig& config) {
  return {config.duration, config.haptic_step,  config.visual_step, config.latency, config.aim == AimName::predicted,
          config.substeps, config.substeps_auto};
}

DeviceTarget aimAt(const DeviceState& device, const RunTiming& timing) {
  if (!timing.predicted_aim) return {device.pose, device.twist};
  return {advance(device.pose, timing.visual_step * device.twist), device.twist};
}

VisualStepSettings visualSettings(const BuiltScene& scene, const RunTiming& timing) {
  return {scene.linearization, timing.visual_step, timing.substeps};
}

HandleModel startModel(BuiltScene& scene, const RunTiming& timing) {
  if (scene.world.evaluate({scene.start, Vec6::Zero()}, timing.visual_step).failed()) {
    throw RunError("the first visual step failed");
  }
  return linearize(scene.world, scene.linearization, 0.0);
}

Vec6 startHaptics(BuiltScene& scene, HapticLoop& loop) {
  const Vec6 wrench = loop.start(scene.start, scene.world.tool().state.handle.pose, 0.0);
  scene.device->begin(wrench);
  return wrench;
}

}  // namespace palpate
