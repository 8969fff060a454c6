#include "palpate/session/lockstep.h"

#include <chrono>
#include <cmath>
#include <deque>

#include "palpate/common/error.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/haptics/realtime.h"
#include "palpate/math/rotation.h"

namespace palpate {

RunTiming timingOf(const SceneConfig& config) {
  return {config.duration, config.haptic_step, config.visual_step, config.latency, config.aim == AimName::predicted};
}

DeviceTarget aimAt(const DeviceState& device, const RunTiming& timing) {
  if (!timing.predicted_aim) return {device.pose, device.twist};
  return {advance(device.pose, timing.visual_step * device.twist), device.twist};
}

VisualRecord visualStep(World& world, const DeviceTarget& target, const LinearizationSettings& settings, double h,
                        double time, const HandleModel& previous) {
  VisualRecord record;
  record.time = time;
  record.step = world.step(target, h);
  const auto begin = std::chrono::steady_clock::now();
  record.model = record.step.status == StepStatus::restored ? previous : linearize(world, settings, time);
  record.linearization_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return record;
}

HandleModel startModel(BuiltScene& scene, const RunTiming& timing) {
  const StepReport report = scene.world.evaluate({scene.start, Vec6::Zero()}, timing.visual_step);
  if (report.status == StepStatus::restored) throw RunError("the first visual step failed");
  return linearize(scene.world, scene.linearization, 0.0);
}

Vec6 startHaptics(BuiltScene& scene, HapticLoop& loop) {
  const Vec6 wrench = loop.start(scene.start, scene.world.tool().handle().pose, 0.0);
  if (auto* simulated = dynamic_cast<SimulatedDevice*>(scene.device.get())) simulated->startInEquilibrium(wrench);
  return wrench;
}

RunOutcome runLockstep(BuiltScene& scene, const RunTiming& timing, const RunSink& sink) {
  struct Arrival {
    std::int64_t tick;
    HandleModel model;
  };
  const auto ticks = static_cast<std::int64_t>(std::llround(timing.duration / timing.haptic_step));
  const auto ticks_per_step = static_cast<std::int64_t>(std::llround(timing.visual_step / timing.haptic_step));
  HapticLoop loop(scene.haptic);
  DeviceFilter filter(scene.haptic.filter);
  filter.reset(scene.start);
  HandleModel newest = startModel(scene, timing);
  HandleModel last = newest;
  startHaptics(scene, loop);
  std::deque<Arrival> arrivals;
  DurationHistogram work;
  for (std::int64_t i = 0; i < ticks; ++i) {
    const double t = static_cast<double>(i) * timing.haptic_step;
    const DeviceState device = scene.device->sample(t);
    if (i % ticks_per_step == 0) {
      const DeviceTarget target = aimAt(filter.accept(device), timing);
      const VisualRecord record = visualStep(scene.world, target, scene.linearization, timing.visual_step, t, last);
      last = record.model;
      arrivals.push_back({i + timing.latency * ticks_per_step, record.model});
      sink.visual(record);
      sink.progress(static_cast<double>(i) / static_cast<double>(ticks));
    }
    while (!arrivals.empty() && arrivals.front().tick <= i) {
      newest = arrivals.front().model;
      arrivals.pop_front();
    }
    const auto begin = std::chrono::steady_clock::now();
    const TickRecord record = loop.tick(device, &newest, t);
    work.add(std::chrono::nanoseconds(std::chrono::steady_clock::now() - begin).count());
    scene.device->apply(record.sent, t, timing.haptic_step);
    sink.tick(record);
  }
  sink.progress(1.0);
  RunOutcome out;
  out.counters = loop.counters();
  out.delivered_energy = loop.passivity().delivered();
  out.ticks = static_cast<std::uint64_t>(ticks);
  out.tick_us = {work.percentile(0.5), work.percentile(0.99), work.max()};
  return out;
}

}  // namespace palpate
