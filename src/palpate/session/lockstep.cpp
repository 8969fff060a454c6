#include "palpate/session/lockstep.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "palpate/common/parallel.h"

namespace palpate {

LockstepRun::LockstepRun(BuiltScene& scene, const RunTiming& timing, const RunSink& sink)
    : scene_(scene),
      timing_(timing),
      sink_(sink),
      ticks_(std::llround(timing.duration / timing.haptic_step)),
      ticks_per_step_(std::llround(timing.visual_step / timing.haptic_step)),
      loop_(scene.haptic),
      filter_(scene.haptic.filter),
      newest_(startModel(scene, timing)),
      last_(newest_),
      live_(scene.live, timing.haptic_step) {
  filter_.reset(scene.start);
  startHaptics(scene, loop_);
  if (!isLive(scene)) return;
  live_.begin(scene.world, timing.visual_step, 0, 0.0);
  loop_.offer({live_.model(), startState(live_.model())});
}

void LockstepRun::runUntil(std::int64_t end) {
  for (; tick_ < end; ++tick_) {
    stopped_ = sink_.stopped();
    if (stopped_) return;
    const double t = static_cast<double>(tick_) * timing_.haptic_step;
    const DeviceState device = scene_.device->sample(t);
    if (tick_ % ticks_per_step_ == 0) visualStepAt(t, device);
    // so that no thread sleeps when the next step comes, which is soon
    if (Executor* executor = Executor::current();
        executor != nullptr && tick_ % ticks_per_step_ == ticks_per_step_ / 2) {
      executor->wake();
    }
    while (!arrivals_.empty() && arrivals_.front().tick <= tick_) {
      arrive(arrivals_.front());
      arrivals_.pop_front();
    }
    tickAt(t, device);
  }
}

void LockstepRun::visualStepAt(double t, const DeviceState& device) {
  const DeviceTarget target = aimAt(filter_.accept(device), timing_);
  const VisualStepSettings settings = visualSettings(scene_, timing_);
  const VisualRecord record = isLive(scene_) ? live_.step(scene_.world, loop_.path(), target, settings, t, last_)
                                             : visualStep(scene_.world, target, settings, t, last_);
  last_ = record.model;
  std::int64_t arrival = tick_ + timing_.latency * ticks_per_step_ + delayTicks(timing_, tick_);
  if (!arrivals_.empty()) arrival = std::max(arrival, arrivals_.back().tick);  // none overtakes the one before
  arrivals_.push_back({arrival, record.model, nullptr});
  if (isLive(scene_)) arrivals_.back().live = std::make_shared<LiveModel>(live_.model());
  sink_.stepped(scene_.world, record);
  sink_.visual(record);
  sink_.progress(static_cast<double>(tick_) / static_cast<double>(ticks_));
}

// A live model comes replayed along the path that the proxy has taken meanwhile.
void LockstepRun::arrive(const ModelArrival& arrival) {
  newest_ = arrival.model;
  if (!arrival.live) return;
  LiveUpdate update{*arrival.live, {}};
  replay_.replayAll(tick_, update.model, timing_.haptic_step, scene_.world.gravity, loop_.path(), update.state);
  loop_.offer(update);
}

void LockstepRun::tickAt(double t, const DeviceState& device) {
  const auto begin = std::chrono::steady_clock::now();
  const TickRecord record = loop_.tick(device, &newest_, t);
  work_.add(std::chrono::nanoseconds(std::chrono::steady_clock::now() - begin).count());
  scene_.device->apply(record.sent, t, timing_.haptic_step);
  sink_.tick(record);
}

LockstepState LockstepRun::state() const {
  return {tick_, scene_.world.state(), loop_.state(), filter_.state(), scene_.device->save(), newest_,
          last_, live_.state(),        arrivals_};
}

void LockstepRun::restore(const LockstepState& state) {
  scene_.world.restore(state.world);
  scene_.device->restore(state.device);
  loop_.restore(state.haptic);
  filter_.restore(state.filter);
  tick_ = state.tick;
  newest_ = state.newest;
  last_ = state.last;
  live_.restore(state.live);
  arrivals_ = state.arrivals;
}

RunOutcome LockstepRun::outcome() const {
  RunOutcome out;
  out.counters = loop_.counters();
  out.delivered_energy = loop_.passivity().delivered();
  out.switches = loop_.switches();
  out.ticks = static_cast<std::uint64_t>(tick_);
  out.end_time = static_cast<double>(tick_) * timing_.haptic_step;
  out.stopped = stopped_;
  out.tick_us = {work_.percentile(0.5), work_.percentile(0.99), work_.max(), work_.percentile(0.999)};
  return out;
}

RunOutcome runLockstep(BuiltScene& scene, const RunTiming& timing, const RunSink& sink) {
  LockstepRun run(scene, timing, sink);
  run.runUntil(run.ticks());
  sink.progress(1.0);
  return run.outcome();
}

}  // namespace palpate
