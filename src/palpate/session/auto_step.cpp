#include "palpate/session/auto_step.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "palpate/scene/builder.h"
#include "palpate/session/lockstep.h"

namespace palpate {
namespace {

/// Of a step and its model [s], at most in 99 % of the steps of a run that may end early.
double costOf(BuiltScene& scene, const RunTiming& timing, double patience, const std::function<bool()>& stopped) {
  std::vector<double> costs;
  const auto begin = std::chrono::steady_clock::now();
  RunSink sink;
  sink.visual = [&](const VisualRecord& r) { costs.push_back(r.step.times.total() + r.linearization_s); };
  sink.stopped = [&] {
    return stopped() || std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() > patience;
  };
  LockstepRun run(scene, timing, sink);
  const LockstepState start = run.state();
  run.runUntil(run.ticks());
  run.restore(start);
  if (costs.empty()) return 0.0;
  const auto at = costs.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(costs.size() - 1));
  std::nth_element(costs.begin(), at, costs.end());
  return *at;
}

}  // namespace

std::vector<double> autoSteps(double haptic_step, double longest) {
  const auto most = static_cast<std::int64_t>(std::llround(longest / haptic_step));
  std::vector<double> out;
  for (std::int64_t ticks = 1; ticks < most; ticks = std::max(ticks + 1, ticks + ticks / 4)) {
    out.push_back(static_cast<double>(ticks) * haptic_step);
  }
  out.push_back(longest);
  return out;
}

AutoStep chooseVisualStep(const SceneConfig& config, double patience, const std::function<bool()>& stopped) {
  SceneConfig warm_up = config;
  if (isHardware(config.device.kind)) {  // the warm-up is not in real time: nobody may feel it
    warm_up.device.kind = DeviceName::simulated;
    warm_up.device.driver.reset();
  }
  BuiltScene scene = buildScene(warm_up);
  RunTiming timing = timingOf(config);
  timing.substeps_auto = false;
  const double at_longest = costOf(scene, timing, patience, stopped);
  double least = at_longest;  // that the chosen step must leave room for
  for (const double step : autoSteps(config.haptic_step, config.visual_step)) {
    if (step >= config.visual_step || stopped()) break;
    if (least > kAutoShare * step) continue;
    timing.visual_step = step;
    const double cost = std::max(at_longest, costOf(scene, timing, patience, stopped));
    if (cost <= kAutoShare * step) return {step, cost, true};
    least = cost;
  }
  return {config.visual_step, at_longest, at_longest <= kAutoShare * config.visual_step};
}

}  // namespace palpate
