#include <fmt/format.h>

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "command_line.h"
#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/record/text_table.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"
#include "palpate/study/soak.h"
#include "progress.h"
#include "scene_options.h"

namespace palpate {
namespace {

struct SoakOptions {
  std::vector<std::string> scenes;
  SoakSettings settings;
  std::optional<std::string> method;
  std::optional<std::uint64_t> seed;
  std::string out = "out/soak";
};

void soak(const SoakOptions& options) {
  std::vector<SceneConfig> configs;
  for (const std::string& scene : options.scenes) {
    configs.push_back(readScene(scene));
    Overrides overrides;
    overrides.method = options.method;
    overrides.seed = options.seed;
    applyOverrides(configs.back(), overrides);
    withRandomMotion(configs.back(), 1.0);  // says what a scene lacks, before any has run
  }
  OutputFolder folder(options.out);
  const InterruptionAsks asks;
  std::vector<std::vector<std::string>> rows{{"scene", "s", "ticks", "missed", "steps", "models used", "late",
                                              "refused", "memory, MiB", "growing by", "swings stopped"}};
  nlohmann::ordered_json summary = nlohmann::ordered_json::array();
  std::vector<std::string> failures;
  for (const SceneConfig& config : configs) {
    if (interruptionAsked()) break;
    Progress progress(fmt::format("{}: {:g} s in real time", config.name, options.settings.duration));
    const SoakOutcome o = runSoak(config, options.settings, [&](double share) {
      progress(share);
      return !interruptionAsked().load();
    });
    const ModelTraffic& models = o.run.models;
    rows.push_back({config.name, fmt::format("{:.0f}", o.duration), fmt::format("{}", o.run.ticks),
                    fmt::format("{}", o.run.missed), fmt::format("{}", o.steps), fmt::format("{}", models.account.used),
                    fmt::format("{}", models.overwritten + models.account.overtaken),
                    fmt::format("{}", models.account.refused), fmt::format("{:.1f}", o.memory_peak),
                    fmt::format("{:.2f}", o.memory_growth), fmt::format("{}", o.run.counters[TickFlag::oscillation])});
    summary.push_back(soakJson(config.name, o));
    for (const std::string& line : o.failures) failures.push_back(config.name + ": " + line);
  }
  fmt::print("{}", alignedColumns(rows, 1));
  writeJson(folder.stage("summary.json"), summary);
  folder.commit();
  if (interruptionAsked()) throw Interrupted("interrupted; what there is is in " + options.out, interruptionSignal());
  for (const std::string& line : failures) fmt::print("  FAILED: {}\n", line);
  if (!failures.empty()) throw ChecksFailed(fmt::format("{} criteria failed", failures.size()));
}

}  // namespace

void addSoakCommand(CLI::App& app) {
  const auto options = std::make_shared<SoakOptions>();
  CLI::App* command = app.add_subcommand(
      "soak", "Run scenes in real time for long, in random hands; exit code 3 if memory grows or anything is lost");
  command->add_option("scenes", options->scenes, "Scene files (YAML), one after the other")
      ->required()
      ->type_name("SCENE...");
  command->add_option("--duration", options->settings.duration, "Of each, s")
      ->check(CLI::Range(1.0, 86400.0))
      ->capture_default_str();
  command->add_option("--method", options->method, "live, hsl, hsl-exact or vc")
      ->check(offers(methodNames()))
      ->type_name("NAME");
  addSeed(*command, options->seed, "Of the hands and their motion");
  command
      ->add_option("--out", options->out, "Folder for summary.json")

      ->type_name("DIR")
      ->capture_default_str();
  command->callback([options] { soak(*options); });
}

}  // namespace palpate
