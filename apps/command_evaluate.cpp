#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "commands.h"
#include "palpate/record/output_folder.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"
#include "palpate/study/evaluate.h"
#include "palpate/study/hands.h"
#include "progress.h"
#include "scene_options.h"

namespace palpate {
namespace {

struct EvaluateOptions {
  std::vector<std::string> scenes;
  Overrides overrides;
  StudySettings study;
  std::vector<std::string> hands, delays;
  std::string out = "out/evaluate";
};

void evaluate(EvaluateOptions options) {
  for (const std::string& delay : options.delays) options.study.delays.push_back(delayFrom(delay));
  std::vector<SceneConfig> configs;  // all are read before the first runs: a mistake shows at once
  for (const std::string& scene : options.scenes) {
    configs.push_back(readScene(scene));
    applyOverrides(configs.back(), options.overrides);
    checkStudy(configs.back(), options.study);
  }
  HandsSettings hands;
  for (const std::string& hand : options.hands) hands.hands.push_back(handFrom(hand));
  const OutputFolder writable(options.out);
  std::vector<SceneStudy> studies;
  for (const SceneConfig& config : configs) {
    Progress progress(fmt::format(
        "{}: reference and {} runs", config.name,
        options.study.methods.size() * options.study.visual_steps.size() * delaysOf(config, options.study).size()));
    studies.push_back(evaluateScene(config, options.study, [&](double share) { progress(share); }));
  }
  std::vector<HandStudy> held;
  for (std::size_t i = 0; i < studies.size() && !hands.hands.empty(); ++i) {
    Progress progress(fmt::format("{}: {} hands", configs[i].name, hands.hands.size()));
    held.push_back(evaluateHands(studies[i], options.study, hands, [&](double share) { progress(share); }));
  }
  writeStudy(studies, options.out, handsJson(held));
  fmt::print("{}{}report: {}/report.html\n", studyTable(studies), held.empty() ? "" : handTable(held), options.out);
}

}  // namespace

void addEvaluateCommand(CLI::App& app) {
  const auto options = std::make_shared<EvaluateOptions>();
  CLI::App* command = app.add_subcommand(
      "evaluate", "Fidelity study: every method along the same motion, against virtual coupling at a 1 ms visual step");
  Overrides& overrides = options->overrides;
  command->add_option("scenes", options->scenes, "Scene files (YAML)")->required()->type_name("SCENE");
  command->add_option("--methods", options->study.methods, "Methods to compare; default all")
      ->check(offers(methodNames()))
      ->delimiter(',')
      ->type_name("A,B");
  command->add_option("--visual-dt", options->study.visual_steps, "Visual steps, s; default 0.010,0.020,0.033")
      ->delimiter(',')
      ->type_name("S,S");
  addCommonOverrides(*command, overrides);
  command
      ->add_option(
          "--delays", options->delays,
          "Latencies to compare, in visual steps, +1 with a jitter of one, such as 1,2,1+1; default the scene's")
      ->delimiter(',')
      ->type_name("L+J,...");
  command
      ->add_option("--hands", options->hands,
                   "Also hold the device in these hands, N/m and N s/m, or none, such as 500/8,200/3,100/2,30/0.5,none")
      ->delimiter(',')
      ->type_name("K/B,...");
  command->add_flag("--reference-check", options->study.reference_check, "Run the reference at half its step too");
  command
      ->add_option("--out", options->out, "Folder for summary.json and report.html")

      ->type_name("DIR")
      ->capture_default_str();
  command->callback([options] { evaluate(*options); });
}

}  // namespace palpate
