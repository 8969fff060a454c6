#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/session/lockstep.h"
#include "palpate/study/check.h"
#include "scene_options.h"

namespace palpate {
namespace {

struct CheckOptions {
  SceneOptions scene;
  double at = 0.0;
  std::string out;
};

// Brings the scene to the visual step at (or just before) a time, as a run does.
DeviceTarget runUntil(BuiltScene& scene, const RunTiming& timing, double at) {
  RunTiming until = timing;
  const auto steps = static_cast<std::int64_t>(std::floor(at / timing.visual_step + 1e-9));
  until.duration = static_cast<double>(steps) * timing.visual_step;
  DeviceFilter filter(scene.haptic.filter);
  filter.reset(scene.start);
  runLockstep(scene, until, RunSink{});
  return aimAt(filter.accept(scene.device->sample(until.duration)), timing);
}

void printErrors(const char* name, const BlockErrors& e) {
  fmt::print("  {:<26}{:>12.2e}{:>12.2e}{:>12.2e}{:>12.2e}\n", name, e.block[0], e.block[1], e.block[2], e.block[3]);
}

void check(const CheckOptions& options) {
  if (!std::isfinite(options.at) || options.at < 0)
    throw InputError("--at", "", "must be a finite time of at least 0 s");
  SceneConfig config = options.scene.read();
  if (options.at > config.duration) {
    throw InputError("--at", "",
                     fmt::format("{} s is after the end of the scene at {} s", options.at, config.duration));
  }
  if (!options.scene.overrides.method) config.method = MethodName::hsl_exact;
  if (config.method == MethodName::vc || config.method == MethodName::live)
    throw InputError("--method", "",
                     fmt::format("{} has no Kx and Kv; give hsl or hsl-exact", toString(config.method)));
  OutputFolder folder(options.out.empty() ? "out/check-" + config.name : options.out);
  BuiltScene scene = buildScene(config);
  const DeviceTarget target = runUntil(scene, timingOf(config), options.at);
  const LinearizationCheck c = checkLinearization(scene.world, target, config.visual_step, scene.linearization);
  fmt::print("{} at {} s, {}, {} derivative: {} contacts carry force, {} stick, {} slide\n", config.name, options.at,
             toString(config.method), toString(config.derivative), c.active, c.sticking, c.sliding);
  fmt::print(
      "  relative error against      force by     force by   torque by   torque by\n"
      "  central differences of    translation    rotation translation    rotation\n");
  printErrors("Kx, frozen step", c.kx_frozen);
  printErrors("Kv, frozen step", c.kv_frozen);
  printErrors("Kx, full step", c.kx_full);
  printErrors("Kv, full step", c.kv_full);
  nlohmann::ordered_json j;
  j["scene"] = config.name;
  j["method"] = toString(config.method);
  j["derivative"] = toString(config.derivative);
  j["at_s"] = options.at;
  j["linearization_check"] = {{"kx_frozen_rel", c.kx_frozen.worst()},
                              {"kv_frozen_rel", c.kv_frozen.worst()},
                              {"kx_full_rel", c.kx_full.worst()},
                              {"kv_full_rel", c.kv_full.worst()},
                              {"active", c.active},
                              {"sticking", c.sticking},
                              {"sliding", c.sliding},
                              {"force_rel", c.force_error},
                              {"kx_frozen_blocks", c.kx_frozen.block},
                              {"kv_frozen_blocks", c.kv_frozen.block},
                              {"kx_full_blocks", c.kx_full.block},
                              {"kv_full_blocks", c.kv_full.block}};
  writeJson(folder.stage("summary.json"), j);
  folder.commit();
}

}  // namespace

void addCheckCommand(CLI::App& app) {
  CLI::App* group = app.add_subcommand("check", "Check the mathematics on a scene");
  group->require_subcommand(1);
  const auto options = std::make_shared<CheckOptions>();
  CLI::App* command = group->add_subcommand(
      "linearization",
      "Compare Kx and Kv with central differences of the step, by block; method hsl-exact unless given");
  options->scene.addScene(*command);
  options->scene.addOverrides(*command);
  command->add_option("--at", options->at, "Time in the run at which to compare, s")->required()->type_name("T");
  command
      ->add_option("--out", options->out, "Folder for summary.json; default out/check-NAME")

      ->type_name("DIR");
  command->callback([options] { check(*options); });
}

}  // namespace palpate
