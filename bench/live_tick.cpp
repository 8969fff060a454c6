// Ticks of the live model of shipped scenes, where most of its contacts are closed: a new model comes every visual
// step, some ticks behind the path, as in real time. Nothing else runs in between, so what is measured is not the cold
// cache that a visual step on the same core leaves.
#include <benchmark/benchmark.h>

#include <chrono>
#include <string>
#include <vector>

#include "palpate/results/statistics.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"
#include "palpate/session/lockstep.h"

namespace palpate {
namespace {

/// @param at      moment of the scene's motion at which the device is held from here on [s]
/// @param behind  ticks for which each model was on its way
void liveTick(benchmark::State& state, const char* name, double at, std::int64_t behind) {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/" + name + ".yaml");
  Overrides overrides;
  overrides.device = "prescribed";
  overrides.method = "live";
  applyOverrides(config, overrides);
  const RunTiming timing = timingOf(config);
  BuiltScene scene = buildScene(config);
  const RunSink sink;
  LockstepRun run(scene, timing, sink);
  run.runUntil(std::llround(at / timing.haptic_step));
  const LockstepState reached = run.state();
  HapticLoop loop(scene.haptic);
  loop.restore(reached.haptic);
  const DeviceState device = scene.device->sample(at);
  LiveUpdate update = reached.haptic.live;
  const std::int64_t every = std::llround(timing.visual_step / timing.haptic_step);

  std::vector<double> all, changing;  // [us]
  std::int64_t i = 0;
  for (auto _ : state) {
    const bool offers = i % every == 0;
    if (offers) {
      update.state.index = update.model.index = loop.path().end() - 1 - behind;
    }
    const double now = at + static_cast<double>(i) * timing.haptic_step;
    const auto begin = std::chrono::steady_clock::now();
    if (offers) loop.offer(update);
    benchmark::DoNotOptimize(loop.tick(device, &reached.newest, now));
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    state.SetIterationTime(seconds);
    all.push_back(1e6 * seconds);
    if (offers) changing.push_back(1e6 * seconds);
    ++i;
  }
  const LiveModel& model = update.model;
  state.counters["modes"] = model.modes();
  state.counters["contacts"] = model.contacts;
  state.counters["used"] = static_cast<double>(loop.models().used);
  state.counters["p50_us"] = percentile(all, 0.5);
  state.counters["p99_us"] = percentile(all, 0.99);
  state.counters["change_us"] = percentile(changing, 0.5);
}

// The same for a loop that only reads the clock for 10 us: what is longer is the machine's doing.
void waiting(benchmark::State& state) {
  std::vector<double> all;  // [us]
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    double seconds = 0;
    while (seconds < 1e-5) seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    state.SetIterationTime(seconds);
    all.push_back(1e6 * seconds);
  }
  state.counters["p50_us"] = percentile(all, 0.5);
  state.counters["p99_us"] = percentile(all, 0.99);
}
BENCHMARK(waiting)->Name("liveTick/waiting")->UseManualTime()->Unit(benchmark::kMicrosecond);

const bool kRegistered = [] {
  const std::vector<std::pair<const char*, double>> scenes{
      {"cube", 3.0}, {"alien-lying", 3.0}, {"plug", 8.0}, {"bunnies", 6.0}};
  for (const auto& [scene, at] : scenes) {
    for (const int behind : {0, 4}) {
      const std::string name = "liveTick/" + std::string(scene) + "/behind:" + std::to_string(behind);
      benchmark::RegisterBenchmark(name.c_str(), liveTick, scene, at, behind)
          ->UseManualTime()
          ->Unit(benchmark::kMicrosecond);
    }
  }
  return true;
}();

}  // namespace
}  // namespace palpate
