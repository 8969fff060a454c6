#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/study/stress_output.h"
#include "progress.h"
#include "scene_options.h"

namespace palpate {
namespace {

struct StressOptions {
  SceneOptions scene;
  std::string hand = "wild";
  std::optional<int> steps, seeds;
  StressMotion motion;
  bool by_clock = false, solve_static = false;
  std::string out;
};

StressSettings settingsOf(const StressOptions& options, const SceneConfig& config) {
  StressSettings out = stressSettingsOf(config);
  out.motion = options.motion;
  out.riding = options.hand == "ride";
  out.by_clock = options.by_clock;
  out.solve_static = options.solve_static;
  if (!out.riding && options.seeds) throw InputError("--seeds", "", "needs --hand ride");
  if (!out.riding && options.solve_static) throw InputError("--static", "", "needs --hand ride");
  out.steps = options.steps.value_or(out.steps);
  out.rides = options.steps ? 0 : options.seeds.value_or(kUsualRides);
  return out;
}

void print(const std::string& scene, const StressSettings& settings, const StressOutcome& o) {
  const StressTally& t = o.all;
  fmt::print("{}: {} steps of {} s, seed {}", scene, t.steps, settings.timing.visual_step, settings.seed);
  if (settings.by_clock) fmt::print(", by the clock");
  if (settings.riding) fmt::print(", {} rides", o.rides.size());
  fmt::print("{}\n", o.stopped ? ", stopped" : "");
  fmt::print("  deepest penetration {:.3f} % of the tool's diagonal; {} vertices on the wrong side after calm\n",
             100 * t.deepest_penetration_rel, t.wrong_side);
  fmt::print(
      "  after calm: {} pairs of triangles cross, {} tetrahedra inverted; on the way: in {} steps ({} of "
      "them not between neighbors) and {}\n",
      t.self_intersections, t.inverted, t.crossed, t.passed, t.folded);
  fmt::print("  steps: {} not finite, {} restored, {} not converged, {} redone, {} with a frozen body\n", t.nan,
             t.restored, t.not_converged, t.redone, t.frozen);
  fmt::print("  cut short: {} steps, {} of them right after another, least share {:.3g}\n", t.cut, t.cut_twice,
             t.least_share);
  fmt::print("  energy at most {:.3g} J (kinetic {:.3g}, elastic {:.3g}); made {:.3g} J, {:.3g} J in one step\n",
             t.max_energy, t.max_kinetic, t.max_elastic, t.energy_made, t.largest_energy_made);
  fmt::print("  step {:.2f} ms in the median, {:.2f} p99, {:.2f} p99.9, {:.2f} at most\n", o.median_ms, o.p99_ms,
             o.p99_9_ms, o.max_ms);
}

void stress(const StressOptions& options) {
  SceneConfig config = options.scene.read();
  const StressSettings settings = settingsOf(options, config);
  const std::string out = options.out.empty() ? "out/stress-" + config.name : options.out;
  OutputFolder folder(out);
  BuiltScene scene = buildScene(config);
  const InterruptionAsks asks;  // until what there is has been written
  StressOutcome o;
  {
    Progress progress("stress " + config.name);
    o = runStress(scene, settings, [&](double share) {
      progress(share);
      return !interruptionAsked().load();
    });
  }
  print(config.name, settings, o);
  if (settings.riding) writeRides(folder.stage("rides.csv"), o.rides);
  writeJson(folder.stage("summary.json"), stressSummary(config.name, settings, o));
  folder.commit();
  const std::vector<std::string> failures = stressFailures(o);
  for (const std::string& line : failures) fmt::print("  FAILED: {}\n", line);
  if (interruptionAsked()) throw Interrupted("interrupted; what there is is in " + out, interruptionSignal());
  if (!failures.empty()) throw ChecksFailed(fmt::format("{}: {} criteria failed", config.name, failures.size()));
}

}  // namespace

void addStressCommand(CLI::App& app) {
  const auto options = std::make_shared<StressOptions>();
  CLI::App* command = app.add_subcommand(
      "stress", "Drive a scene with a violent random hand; exit code 3 if anything crosses, freezes or fails");
  options->scene.addScene(*command);
  options->scene.addOverrides(*command);
  command->remove_option(command->get_option("--duration"));  // steps and rides say how long it is
  command
      ->add_option("--hand", options->hand,
                   "wild: bursts with jumps, then calm; ride: bounded motion from the start and home again, many times")
      ->check(CLI::IsMember({"wild", "ride"}))
      ->capture_default_str();
  CLI::Option* steps = command->add_option("--steps", options->steps, "Visual steps; default 1000, or as rides need")
                           ->type_name("N")
                           ->check(CLI::Range(1, 10000000));
  command->add_option("--seeds", options->seeds, "Rides, with seeds that count up from --seed; default 10")
      ->type_name("N")
      ->check(CLI::Range(1, 1000000))
      ->excludes(steps);
  command->add_option("--speed", options->motion.speed, "Largest of the device, m/s")
      ->check(CLI::Range(0.01, 50.0))
      ->capture_default_str();
  command->add_option("--spin", options->motion.spin, "Largest of the device, rad/s")
      ->check(CLI::Range(0.1, 500.0))
      ->capture_default_str();
  command->add_option("--ride", options->motion.ride, "Length of a ride's way, before it turns home, s")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command->add_flag(
      "--clock", options->by_clock,
      "Steps end early by the clock, as in real time, not by counted operations: no two runs are the same");
  command->add_flag("--static", options->solve_static,
                    "After a ride whose tool touches something, compare with the static solution from there");
  command
      ->add_option("--out", options->out, "Folder for summary.json and rides.csv; default out/stress-NAME")

      ->type_name("DIR");
  command->callback([options] { stress(*options); });
}

}  // namespace palpate
