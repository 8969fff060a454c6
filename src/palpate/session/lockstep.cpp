#include "palpate/session/lockstep.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>

#include "palpate/common/error.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/haptics/realtime.h"
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

namespace {

void addTimes(StepTimes& sum, const StepTimes& t) {
  sum.assemble += t.assemble;
  sum.factorize += t.factorize;
  sum.solve += t.solve;
  sum.contact += t.contact;
  sum.advance += t.advance;
}

// Takes the substeps; the report is the last one's, with the worst of all and the times of all.
StepReport stepFinely(World& world, const DeviceTarget& target, double h, int substeps) {
  StepReport sum;
  for (int k = 0; k < substeps; ++k) {
    StepReport r = world.step(target, h);
    r.penetration = std::max(r.penetration, sum.penetration);
    r.solver_residual = std::max(r.solver_residual, sum.solver_residual);
    r.motion_share = std::min(r.motion_share, sum.motion_share);
    r.solver_iterations += sum.solver_iterations;
    r.passes = std::max(r.passes, sum.passes);
    r.status = std::max(r.status, sum.status);
    addTimes(r.times, sum.times);
    sum = r;
  }
  return sum;
}

}  // namespace

VisualRecord visualStep(World& world, const DeviceTarget& target, const LinearizationSettings& settings, double h,
                        double time, const HandleModel& previous, int substeps) {
  using Clock = std::chrono::steady_clock;
  const auto seconds = [](Clock::time_point since) {
    return std::chrono::duration<double>(Clock::now() - since).count();
  };
  VisualRecord record;
  record.time = time;
  if (substeps <= 1) {
    record.step = world.step(target, h);
    const auto begin = Clock::now();
    record.model = record.step.status == StepStatus::restored ? previous : linearize(world, settings, time);
    record.linearization_s = seconds(begin);
    return record;
  }
  // the derivatives first, from a step as long as their horizon that is then not taken
  const StepReport horizon = world.evaluate(target, h);
  const auto begin = Clock::now();
  record.model = horizon.status == StepStatus::restored ? previous : linearize(world, settings, time);
  record.linearization_s = seconds(begin);
  record.step = stepFinely(world, target, h / substeps, substeps);
  record.step.status = std::max(record.step.status, horizon.status);
  addTimes(record.step.times, horizon.times);
  if (record.step.status == StepStatus::restored) {
    record.model = previous;
  } else {
    record.model.force = couplingWrench(world);
    record.model.handle_pose = world.tool().handle().pose;
    record.model.handle_twist = world.tool().handle().twist;
  }
  return record;
}

void SubstepBudget::took(double seconds) {
  if (!timing_.substeps_auto) return;
  constexpr double kShare = 0.6;       // of the visual step; the rest is for what differs from step to step
  constexpr double kShortest = 0.001;  // [s]
  const double one = seconds / (substeps_ > 1 ? substeps_ + 1 : 1);
  const double fit = kShare * timing_.visual_step / one - 1.0;
  const int most = static_cast<int>(timing_.visual_step / kShortest + 1e-9);
  const int wanted = fit < 2 ? 1 : std::min(static_cast<int>(std::min(fit, 1e6)), most);
  // down at once, up by one at a time
  substeps_ = std::max(1, std::min(wanted, substeps_ + 1));
}

HandleModel startModel(BuiltScene& scene, const RunTiming& timing) {
  const StepReport report = scene.world.evaluate({scene.start, Vec6::Zero()}, timing.visual_step);
  if (report.status == StepStatus::restored) throw RunError("the first visual step failed");
  return linearize(scene.world, scene.linearization, 0.0);
}

Vec6 startHaptics(BuiltScene& scene, HapticLoop& loop) {
  const Vec6 wrench = loop.start(scene.start, scene.world.tool().handle().pose, 0.0);
  scene.device->begin(wrench);
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
      const VisualRecord record =
          visualStep(scene.world, target, scene.linearization, timing.visual_step, t, last, timing.substeps);
      last = record.model;
      arrivals.push_back({i + timing.latency * ticks_per_step, record.model});
      sink.stepped(scene.world, record);
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
