#include <algorithm>
#include <optional>

#include "palpate/haptics/coupling.h"
#include "palpate/library/convert.h"
#include "palpate/library/scene.h"
#include "palpate/library/world.h"
#include "palpate/scene/hardware.h"
#include "palpate/session/lockstep.h"
#include "palpate/session/realtime_loops.h"

namespace palpate::v0 {

using library::guarded;
using library::to;

namespace {

constexpr double kStartRamp = 1.5;  // with a hand on the device, as scene/hardware.cpp has it [s]

// With the user's device in place of the scene's.
SceneConfig configFor(SceneConfig config, const RunOptions& options) {
  if (!options.device) return config;
  config.device.kind = DeviceName::prescribed;
  config.device.limits = library::from(options.device->limits());
  config.link = config.link_given.over(linkForDevice(config.device.limits));
  if (options.device->isReal() && config.safety.settings.start_ramp <= 0.0)
    config.safety.settings.start_ramp = kStartRamp;
  return config;
}

RunSink sinkOf(const RunOptions& options) {
  RunSink sink;
  if (options.tick) sink.tick = [f = options.tick](const TickRecord& r) { f(to(r)); };
  if (options.visual) sink.visual = [f = options.visual](const VisualRecord& r) { f(visualStepOf(r)); };
  if (options.stopped) sink.stopped = options.stopped;
  return sink;
}

Percentiles percentiles(const std::vector<double>& p50_p99_max_p99_9) {
  const std::vector<double>& p = p50_p99_max_p99_9;
  return p.size() < 4 ? Percentiles{} : Percentiles{p[0], p[1], p[3], p[2]};
}

RunSummary summaryOf(const RunOutcome& o) {
  RunSummary out;
  out.ticks = o.ticks;
  out.end_time = o.end_time;
  out.stopped = o.stopped;
  out.failure = o.failure;
  out.delivered_energy = o.delivered_energy;
  out.tick_us = percentiles(o.tick_us);
  for (std::size_t k = 0; k < out.flags.size(); ++k) out.flags[k] = o.counters[static_cast<palpate::TickFlag>(k)];
  out.missed = o.missed;
  out.wake_us = percentiles(o.wake_us);
  out.note = o.realtime_note;
  return out;
}

}  // namespace

struct RunState::Impl {
  LockstepState state;
};

RunState::RunState() = default;
RunState::RunState(const RunState&) = default;
RunState& RunState::operator=(const RunState&) = default;
RunState::~RunState() = default;

struct Run::Impl {
  Impl(const SceneConfig& config, RunOptions of)
      : options(std::move(of)),
        world(std::make_unique<World::Impl>(configFor(config, options), options.threads)),
        sink(sinkOf(options)) {
    BuiltScene& scene = world.impl_->scene;
    if (options.device) scene.device = std::make_unique<library::AdoptedDevice>(*options.device, scene.start);
  }
  ThreadTeam* team() const { return world.impl_->team.get(); }

  RunOptions options;
  World world;
  RunSink sink;
  std::optional<LockstepRun> run;
};

Run::Run(const Scene& scene, RunOptions options)
    : impl_(guarded([&] {
        const SceneConfig& config = scene.impl_->config;
        if (options.device ? options.device->isReal() : isHardware(config.device.kind)) {
          throw palpate::InputError(config.file.string(), "device",
                                    "a hand keeps no virtual time: use Run::realtime()");
        }
        auto impl = std::make_unique<Impl>(config, std::move(options));
        World::Impl& world = *impl->world.impl_;
        const ExecutorScope scope(impl->team());
        impl->run.emplace(world.scene, world.timing, impl->sink);
        return impl;
      })) {}
Run::~Run() = default;
Run::Run(Run&&) noexcept = default;
Run& Run::operator=(Run&&) noexcept = default;

std::int64_t Run::ticks() const noexcept { return impl_->run->ticks(); }
std::int64_t Run::next() const noexcept { return impl_->run->tick(); }

bool Run::advance(std::int64_t ticks) {
  return guarded([&] {
    const ExecutorScope scope(impl_->team());
    LockstepRun& run = *impl_->run;
    const std::int64_t end = run.tick() + std::clamp<std::int64_t>(ticks, 0, run.ticks() - run.tick());
    run.runUntil(end);
    return run.tick() == end && end < run.ticks();
  });
}

RunSummary Run::finish() {
  advance(ticks());
  return summary();
}

RunSummary Run::summary() const { return summaryOf(impl_->run->outcome()); }
const World& Run::world() const noexcept { return impl_->world; }

RunState Run::save() const {
  RunState out;
  out.impl_ = guarded([&] { return std::make_shared<RunState::Impl>(RunState::Impl{impl_->run->state()}); });
  return out;
}

void Run::restore(const RunState& state) {
  if (!state.impl_) throw InputError("state of a run", "", "there is none");
  guarded([&] { impl_->run->restore(state.impl_->state); });
}

RunSummary Run::realtime(const Scene& scene, RunOptions options) {
  return guarded([&] {
    SceneConfig config = scene.impl_->config;
    if (!options.device) openDevice(config);
    Impl impl(config, std::move(options));
    World::Impl& world = *impl.world.impl_;
    const ExecutorScope scope(impl.team());
    return summaryOf(runRealtime(world.scene, world.timing, impl.sink));
  });
}

}  // namespace palpate::v0
