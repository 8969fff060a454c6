#include "palpate/study/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "palpate/common/error.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/scene/builder.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/text.h"
#include "palpate/session/lockstep.h"
#include "palpate/session/run_timing.h"
#include "palpate/study/side_by_side.h"
#include "palpate/visual/visual_step.h"

namespace palpate {
namespace {

constexpr double kMostTicks = 200000;  // all traces of a scene are in memory at once
constexpr std::size_t kMostVisualSteps = 16, kMostDelays = 16;
constexpr double kOnsetShare = 0.1;  // of the reference's peak
constexpr double kUnhurried = 1000;  // what a step of the reference may cost [s]

/// What a run leaves behind for the comparison.
struct RunTrace {
  WrenchTrace raw;
  MotionTrace motion;          // of the reference only
  std::vector<char> touching;  // of the reference only
  std::vector<char> switched;
  int restored = 0;
};

RunTrace trace(const SceneConfig& config, bool with_motion, const std::function<void(double)>& progress) {
  RunTrace out;
  BuiltScene scene = buildScene(config);
  bool touching = false;
  double age = 0;
  RunSink sink;
  sink.progress = progress;
  sink.visual = [&](const VisualRecord& r) {
    touching = r.step.active > 0;
    if (r.step.status == StepStatus::restored) ++out.restored;
  };
  sink.tick = [&](const TickRecord& r) {
    out.raw.push_back(r.raw);
    out.switched.push_back(r.model_age < age ? 1 : 0);
    age = r.model_age;
    if (!with_motion) return;
    out.motion.push_back(r.device);
    out.touching.push_back(touching ? 1 : 0);
  };
  runLockstep(scene, timingOf(config), sink);
  return out;
}

}  // namespace

std::vector<Delay> delaysOf(const SceneConfig& config, const StudySettings& settings) {
  if (!settings.delays.empty()) return settings.delays;
  return {{config.latency, config.jitter}};
}

Delay delayFrom(const std::string& text) {
  Delay delay;
  const char* const end = text.data() + text.size();
  auto read = std::from_chars(text.data(), end, delay.latency);
  if (read.ec == std::errc() && read.ptr != end && *read.ptr == '+') {
    read = std::from_chars(read.ptr + 1, end, delay.jitter);
  }
  if (read.ec != std::errc() || read.ptr != end) {
    throw InputError("--delays", "",
                     fmt::format("{} is no delay: LATENCY or LATENCY+JITTER in visual steps", shownText(text)));
  }
  return delay;
}

std::string toString(const Delay& delay) {
  return delay.jitter == 0 ? fmt::format("{}", delay.latency) : fmt::format("{}+{}", delay.latency, delay.jitter);
}

SceneConfig variantOf(const SceneConfig& config, const std::string& method, double visual_step,
                      const std::optional<Delay>& delay) {
  SceneConfig out = config;
  Overrides overrides;
  overrides.method = method;
  overrides.visual_dt = visual_step;
  if (delay) {
    overrides.latency = delay->latency;
    overrides.jitter = delay->jitter;
  }
  applyOverrides(out, overrides);
  return out;
}

void checkStudy(const SceneConfig& config, const StudySettings& settings) {
  const std::vector<std::string>& known = methodNames();
  for (const std::string& method : settings.methods) {
    if (std::find(known.begin(), known.end(), method) == known.end()) {
      throw InputError("--methods", "", fmt::format("{} is not one of {}", shownText(method), fmt::join(known, ", ")));
    }
  }
  if (settings.methods.empty()) throw InputError("--methods", "", "names no method");
  if (settings.visual_steps.empty()) throw InputError("--visual-dt", "", "names no visual step");
  if (settings.visual_steps.size() > kMostVisualSteps || settings.methods.size() > known.size()) {
    throw InputError("--visual-dt", "",
                     fmt::format("a study holds at most {} visual steps and each method once", kMostVisualSteps));
  }
  if (settings.delays.size() > kMostDelays) {
    throw InputError("--delays", "", fmt::format("a study holds at most {} delays", kMostDelays));
  }
  if (config.duration / config.haptic_step > kMostTicks) {
    throw InputError("--duration", "",
                     fmt::format("a study holds at most {:.0f} haptic ticks, which is {} s here", kMostTicks,
                                 kMostTicks * config.haptic_step));
  }
  for (const double visual_step : settings.visual_steps) {
    for (const Delay& delay : delaysOf(config, settings)) {
      variantOf(config, settings.methods.front(), visual_step, delay);
    }
  }
}

namespace {

// The path of the hand stands for the hand, so that the motion does not depend on the force.
SceneConfig withGivenMotion(SceneConfig config) {
  if (config.device.kind == DeviceName::simulated) config.device.kind = DeviceName::prescribed;
  return config;
}

// Times of the half-step run that the reference has too
TraceError halfStepError(const SceneConfig& reference_config, const WrenchTrace& reference,
                         const std::function<void(double)>& progress) {
  SceneConfig fine = reference_config;
  fine.haptic_step *= 0.5;
  fine.visual_step *= 0.5;
  const RunTrace run = trace(fine, false, progress);
  WrenchTrace common;
  for (std::size_t i = 0; i < reference.size(); ++i) common.push_back(run.raw[std::min(2 * i, run.raw.size() - 1)]);
  return traceError(reference, common);
}

void measure(SceneStudy& study, const std::vector<char>& touching) {
  const double dt = study.config.haptic_step;
  study.reference_peak = peakForce(study.reference);
  study.reference_returned = returnedEnergy(study.reference, study.motion);
  study.segments = settledFreeSegments(study.motion, touching, dt);
  const std::optional<std::size_t> contact = contactOnset(touching);
  const double threshold = kOnsetShare * study.reference_peak;
  std::optional<double> reference_rise;
  if (contact) {
    study.contact_time = static_cast<double>(*contact) * dt;
    reference_rise = forceRise(study.reference, *contact, threshold, dt);
  }
  const std::optional<std::size_t> ended = contactRelease(touching, dt);
  std::optional<Vec3> free_force;
  std::optional<double> reference_release;
  if (ended) {
    study.release_time = static_cast<double>(*ended) * dt;
    free_force = freeForce(study.reference, *ended, dt);
    reference_release = forceRelease(study.reference, *ended, *free_force, threshold, dt);
  }
  for (StudyRow& row : study.rows) {
    row.error = traceError(row.trace, study.reference);
    row.drag = drag(row.trace, study.reference, study.motion, study.segments);
    row.returned = returnedEnergy(row.trace, study.motion);
    row.switch_step = switchStep(row.trace, study.reference, row.switched);
    if (free_force) {
      const std::optional<double> release = forceRelease(row.trace, *ended, *free_force, threshold, dt);
      if (release && reference_release) row.release = *release - *reference_release;
      row.glue = glue(row.trace, study.reference, *ended, dt);
    }
    if (!reference_rise) continue;
    const std::optional<double> rise = forceRise(row.trace, *contact, threshold, dt);
    if (rise) row.onset = *rise - *reference_rise;
  }
}

}  // namespace

SceneConfig referenceConfig(const SceneConfig& config) {
  SceneConfig out = withGivenMotion(config);
  out.method = MethodName::vc;
  out.visual_step = out.haptic_step;
  out.substeps = 1;
  out.substeps_auto = false;
  out.latency = 0;
  out.jitter = 0;
  out.aim = AimName::sample;
  out.visual_budget = kUnhurried;
  return out;
}

WrenchTrace idealRendering(const SceneConfig& config, double visual_step) {
  BuiltScene scene = buildScene(withGivenMotion(config));
  DeviceFilter filter(scene.haptic.filter);
  filter.reset(scene.start);
  const auto wrenchNow = [&](const DeviceState& device) {
    const HandleState& handle = scene.world.tool().state.handle;
    return couplingWrench(scene.haptic.link, handle.pose, handle.twist, device);
  };
  WrenchTrace samples{wrenchNow({scene.start, Vec6::Zero(), 0})};
  RunTiming timing = timingOf(config);
  timing.visual_step = visual_step;
  const VisualStepSettings settings = visualSettings(scene, timing);
  const auto steps = static_cast<std::size_t>(std::ceil(config.duration / visual_step - 1e-9));
  for (std::size_t k = 1; k <= steps; ++k) {
    const DeviceState device = filter.accept(scene.device->sample(static_cast<double>(k) * visual_step));
    // a failed step leaves the last good state; it shows in the floor as the error that it is
    visualStep(scene.world, {device.pose, device.twist}, settings, static_cast<double>(k) * visual_step, {});
    samples.push_back(wrenchNow(device));
  }
  const auto ticks = static_cast<std::size_t>(std::llround(config.duration / config.haptic_step));
  return interpolateSamples(samples, visual_step, ticks, config.haptic_step);
}

SceneStudy evaluateScene(const SceneConfig& scene, const StudySettings& settings,
                         const std::function<void(double)>& progress) {
  checkStudy(scene, settings);
  SceneStudy study;
  study.config = withGivenMotion(scene);
  const SceneConfig reference_config = referenceConfig(scene);
  const auto steps = [&](double visual_step) { return scene.duration / visual_step; };

  SideBySide jobs;
  RunTrace reference;
  const double fine = steps(reference_config.visual_step);
  jobs.add(fine, [&](const auto& share) { reference = trace(reference_config, true, share); });
  const std::vector<Delay> delays = delaysOf(scene, settings);
  const std::size_t each = settings.methods.size() * delays.size();  // rows of a visual step
  std::vector<RunTrace> runs(settings.visual_steps.size() * each);
  std::vector<WrenchTrace> floors(settings.visual_steps.size());
  for (std::size_t k = 0; k < settings.visual_steps.size(); ++k) {
    const double visual_step = settings.visual_steps[k];
    for (std::size_t m = 0; m < each; ++m) {
      const std::string& method = settings.methods[m / delays.size()];
      const Delay& delay = delays[m % delays.size()];
      const SceneConfig config = variantOf(study.config, method, visual_step, delay);
      RunTrace& out = runs[study.rows.size()];
      jobs.add(steps(visual_step), [config, &out](const auto& share) { out = trace(config, false, share); });
      StudyRow row;
      row.method = method;
      row.visual_step = visual_step;
      row.delay = delay;
      study.rows.push_back(std::move(row));
    }
    jobs.add(steps(visual_step), [&, k, visual_step](const auto& share) {
      floors[k] = idealRendering(study.config, visual_step);
      share(1.0);
    });
  }
  jobs.run(progress);

  study.reference = std::move(reference.raw);
  study.motion = std::move(reference.motion);
  for (std::size_t i = 0; i < study.rows.size(); ++i) {
    const TraceError floor = traceError(floors[i / each], study.reference);
    study.rows[i].trace = std::move(runs[i].raw);
    study.rows[i].switched = std::move(runs[i].switched);
    study.rows[i].restored = runs[i].restored;
    study.rows[i].floor_rms = floor.rms_force;
    study.rows[i].floor_rms_torque = floor.rms_torque;
  }
  measure(study, reference.touching);
  if (settings.reference_check) study.reference_error = halfStepError(reference_config, study.reference, progress);
  return study;
}

}  // namespace palpate
