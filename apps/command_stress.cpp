#include <fmt/format.h>

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "commands.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/study/stress.h"
#include "progress.h"
#include "scene_options.h"

namespace palpate {
namespace {

struct StressOptions {
  SceneOptions scene;
  int steps = 1000;
  std::string out;
};

void stress(const StressOptions& options) {
  SceneConfig config = options.scene.read();
  OutputFolder folder(options.out.empty() ? "out/stress-" + config.name : options.out);
  BuiltScene scene = buildScene(config);
  StressSettings settings;
  settings.steps = options.steps;
  settings.seed = config.seed;
  settings.step = config.visual_step;
  settings.max_force = config.device.limits.peak_force;
  settings.max_torque = config.device.limits.peak_torque;
  StressOutcome o;
  {
    Progress progress("stress " + config.name);
    o = runStress(scene, settings, std::ref(progress));
  }
  fmt::print("{}: {} steps of {} s, seed {}\n", config.name, o.steps, settings.step, settings.seed);
  fmt::print("  deepest penetration {:.3f} % of the tool's diagonal, {} vertices on the wrong side after calm\n",
             100 * o.deepest_penetration_rel, o.wrong_side);
  fmt::print("  {} steps not finite, {} restored, {} not converged, {} with a motion cut short\n", o.nan, o.restored,
             o.not_converged, o.cut);
  fmt::print(
      "  energy at most {:.3g} J (kinetic {:.3g}, elastic {:.3g}); step {:.2f} ms in the median, {:.2f} p99, {:.2f} at "
      "most\n",
      o.max_energy, o.max_kinetic, o.max_elastic, o.median_ms, o.p99_ms, o.max_ms);
  nlohmann::ordered_json j;
  j["scene"] = config.name;
  j["seed"] = settings.seed;
  j["step_s"] = settings.step;
  j["steps"] = o.steps;
  j["deepest_penetration_rel"] = o.deepest_penetration_rel;
  j["nan"] = o.nan;
  j["wrong_side"] = o.wrong_side;
  j["max_energy_J"] = o.max_energy;
  j["max_kinetic_J"] = o.max_kinetic;
  j["max_elastic_J"] = o.max_elastic;
  j["restored"] = o.restored;
  j["not_converged"] = o.not_converged;
  j["cut"] = o.cut;
  j["step_ms"] = {{"median", o.median_ms}, {"p99", o.p99_ms}, {"max", o.max_ms}};
  writeJson(folder.stage("summary.json"), j);
  folder.commit();
}

}  // namespace

void addStressCommand(CLI::App& app) {
  const auto options = std::make_shared<StressOptions>();
  CLI::App* command = app.add_subcommand(
      "stress", "Drive a scene with violent random device motion and report penetration, energy and failures");
  options->scene.addScene(*command);
  options->scene.addOverrides(*command);
  command->add_option("--steps", options->steps, "Visual steps; default 1000")
      ->type_name("N")
      ->check(CLI::Range(1, 10000000));
  command->add_option("--out", options->out, "Folder for summary.json; default out/stress-NAME")
      ->check(kNotEmpty)
      ->type_name("DIR");
  command->callback([options] { stress(*options); });
}

}  // namespace palpate
