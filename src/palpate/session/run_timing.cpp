#include "palpate/session/run_timing.h"

#include <cmath>
#include <random>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"

namespace palpate {

RunTiming timingOf(const SceneConfig& config) {
  RunTiming timing;
  timing.duration = config.duration;
  timing.haptic_step = config.haptic_step;
  timing.visual_step = config.visual_step;
  timing.latency = config.latency;
  timing.jitter = config.jitter;
  timing.seed = config.seed;
  timing.predicted_aim = config.aim == AimName::predicted;
  timing.substeps = config.substeps;
  timing.substeps_auto = config.substeps_auto;
  return timing;
}

std::int64_t delayTicks(const RunTiming& timing, std::int64_t tick) {
  if (timing.jitter == 0) return 0;
  const std::int64_t most = timing.jitter * std::llround(timing.visual_step / timing.haptic_step);
  std::seed_seq seed{static_cast<std::uint32_t>(timing.seed), static_cast<std::uint32_t>(timing.seed >> 32),
                     static_cast<std::uint32_t>(tick), static_cast<std::uint32_t>(tick >> 32)};
  std::uint32_t chance = 0;
  seed.generate(&chance, &chance + 1);
  return static_cast<std::int64_t>(chance % static_cast<std::uint64_t>(most + 1));
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
