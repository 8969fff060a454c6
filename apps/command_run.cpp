#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string>

#include "commands.h"
#include "palpate/common/cancellation.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/devices/recorded_device.h"
#include "palpate/interactive/recorder.h"
#include "palpate/results/run_files.h"
#include "palpate/results/snapshots.h"
#include "palpate/scene/hardware.h"
#include "palpate/session/auto_step.h"
#include "palpate/session/lockstep.h"
#include "palpate/session/realtime_loops.h"
#include "progress.h"
#include "scene_options.h"

namespace palpate {
namespace {

struct RunOptions {
  SceneOptions scene;
  std::string out;
  std::string compare;
  bool realtime = false;
  int pictures = 6;
  std::string tables = "csv";
};

// The scene with another method; a name that is none is blamed on the option that gave it.
SceneConfig methodFor(const std::string& option, const std::string& method, SceneConfig config) {
  Overrides overrides;
  overrides.method = method;
  try {
    applyOverrides(config, overrides);
  } catch (const InputError&) {
    throw InputError(option, "", "must be live, hsl, hsl-exact or vc, not '" + method + "'");
  }
  return config;
}

// Another method along the motion that the first run's device made.
Comparison compareAlong(const SceneConfig& scene_config, const std::string& method, const MotionRecording& motion) {
  const SceneConfig config = methodFor("--compare", method, scene_config);
  Comparison out;
  out.method = method;
  BuiltScene scene = buildScene(config);
  scene.device = std::make_unique<RecordedDevice>(motion, config.device.limits);
  Progress progress(fmt::format("{} with {} along the same motion", config.name, method));
  RunSink sink;
  sink.progress = [&](double share) { progress(share); };
  sink.tick = [&](const TickRecord& r) {
    out.time.push_back(r.time);
    out.raw.push_back(r.raw);
  };
  sink.stopped = [] { return interruptionAsked().load(); };
  runLockstep(scene, timingOf(config), sink);
  return out;
}

// The scene for another method along the same motion may take long to build, and nobody waits for it after Ctrl+C.
std::optional<Comparison> compared(const SceneConfig& config, const std::string& method,
                                   const MotionRecording& motion) {
  const CancellationScope cancel(&interruptionAsked());
  try {
    Comparison out = compareAlong(config, method, motion);
    if (!interruptionAsked()) return out;
  } catch (const Cancelled&) {
  }
  fmt::print(stderr, "note: the comparison with {} was not finished and is left out\n", method);
  return std::nullopt;
}

std::string signalName(int signal) { return signal == SIGINT ? "SIGINT" : signal == SIGTERM ? "SIGTERM" : "SIGHUP"; }

// Where nothing is wrong the run was complete.
void tellHowItEnded(const RunOutcome& outcome, const RunFiles& files, const std::string& out) {
  const std::string failure = outcome.failure.empty() ? files.failure() : outcome.failure;
  const std::string kept = fmt::format("what there is, up to {:.3f} s, is in {}", outcome.end_time, out);
  if (!failure.empty()) throw RunError(fmt::format("{}; {}", failure, kept));
  if (interruptionAsked()) throw Interrupted("interrupted: " + kept, interruptionSignal());
}

RunOutcome runScene(const RunOptions& options, const SceneConfig& config, BuiltScene& scene, RunSink& sink) {
  Progress progress(
      fmt::format("{}: {} s {}", config.name, config.duration, options.realtime ? "in real time" : "in lockstep"));
  sink.progress = [&](double share) { progress(share); };
  RunOutcome outcome =
      options.realtime ? runRealtime(scene, timingOf(config), sink) : runLockstep(scene, timingOf(config), sink);
  if (outcome.stopped && interruptionAsked()) outcome.ended_by = signalName(interruptionSignal());
  return outcome;
}

// Where the scene leaves its visual step to the machine: measured, and put in its place.
std::optional<AutoStep> chosenStep(SceneConfig& config) {
  if (!config.visual_step_auto) return std::nullopt;
  fmt::print(stderr, "{}: warm-up, for the visual step\n", config.name);
  const AutoStep chosen = chooseVisualStep(config);
  config.visual_step = chosen.step;
  config.visual_step_auto = false;
  constexpr double kLeastAge = 0.05;  // [s] what a busy machine takes from a thread now and then is no reason to act
  if (!config.safety.model_age_limit) {
    config.safety.model_age_limit = std::max(kLeastAge, modelAgeLimit(chosen.step, config.latency + config.jitter));
  }
  if (!chosen.holds) {
    fmt::print(stderr, "note: steps take {:.3g} ms, more than half of {:g} ms\n", 1e3 * chosen.cost_s,
               1e3 * chosen.step);
  }
  return chosen;
}

void run(RunOptions options) {
  SceneConfig config = options.scene.read();
  if (isHardware(config.device.kind)) options.realtime = true;  // a hand keeps no virtual time
  if (options.realtime && !options.compare.empty()) {
    throw InputError("--compare", "", "needs a run in lockstep, without --realtime");
  }
  if (!options.compare.empty()) methodFor("--compare", options.compare, config);
  openDevice(config);
  const std::optional<AutoStep> chosen = chosenStep(config);
  BuiltScene scene = buildScene(config);
  noteStart(config, scene);
  for (const std::string& note : scene.notes) fmt::print(stderr, "note: {}\n", note);
  const std::string out = options.out.empty() ? "out/" + config.name : options.out;
  const InterruptionAsks asks;  // from here on there is something to be kept
  RunFilesSettings kept;
  if (options.tables == "hdf5") kept.tables = RunTables::hdf5;
  RunFiles files(out, config, kept);
  RunSink sink = files.sink();
  MotionRecording motion;
  motion.has_twist = true;
  if (!options.compare.empty()) {
    sink.tick = [&motion, write = sink.tick](const TickRecord& r) {
      motion.samples.push_back({r.time, r.device});
      write(r);
    };
  }
  Snapshots snapshots(config, scene.world, options.realtime ? 0 : options.pictures);
  if (!options.realtime) sink = snapshots.watch(sink);
  Recorder recorder(files.stage("recording.palpate"), config, scene);
  sink = recorder.watch(sink);
  sink.stopped = [&] { return interruptionAsked() || !files.failure().empty() || recorder.failed(); };
  RunOutcome outcome = runScene(options, config, scene, sink);
  outcome.auto_step = chosen;
  recorder.finish();
  if (outcome.failure.empty()) outcome.failure = files.failure().empty() ? recorder.failure() : files.failure();
  std::optional<Comparison> comparison;
  if (!options.compare.empty() && !outcome.stopped) comparison = compared(config, options.compare, motion);
  files.finish(scene, outcome, comparison ? &*comparison : nullptr, snapshots.draw());
  const bool color = isatty(STDOUT_FILENO) != 0 && std::getenv("NO_COLOR") == nullptr;
  fmt::print("{}, method {}, held by {}\n{}report: {}/report.html\n", config.name, toString(config.method),
             config.tool.handle, files.table(color), out);
  if (!outcome.realtime_note.empty()) fmt::print("real-time priority: {}\n", outcome.realtime_note);
  flushOutput();
  tellHowItEnded(outcome, files, out);
}

}  // namespace

void addRunCommand(CLI::App& app) {
  const auto options = std::make_shared<RunOptions>();
  CLI::App* command = app.add_subcommand("run", "Run a scene and record it: files of numbers and a report to read");
  options->scene.addScene(*command);
  options->scene.addOverrides(*command);
  command->add_flag("--realtime", options->realtime,
                    "Two threads against the clock; otherwise lockstep in virtual time");
  command->add_option("--compare", options->compare, "Method to run along the same motion and show beside")
      ->check(offers(methodNames()))
      ->type_name("NAME");
  command
      ->add_option("--pictures", options->pictures, "Pictures of the run in lockstep, evenly spaced in time; 0: none")
      ->check(CLI::Range(0, kMostPictures))
      ->capture_default_str();
  command
      ->add_option("--table-format", options->tables,
                   "Rows of ticks and of visual steps as haptic.csv and visual.csv, or as haptic.h5 and visual.h5")
      ->check(CLI::IsMember({"csv", "hdf5"}))
      ->capture_default_str();
  command
      ->add_option("--out", options->out, "Folder for the files; default out/NAME of the scene")

      ->type_name("DIR");
  command->callback([options] { run(*options); });
}

}  // namespace palpate
