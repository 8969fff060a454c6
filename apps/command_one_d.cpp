#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <string>

#include "commands.h"
#include "palpate/one_d/output.h"

namespace palpate {

namespace {

struct OneDOptions {
  std::string config;
  std::string out = "out/one-d";
};

void runOneD(const OneDOptions& options) {
  const one_d::Config config = options.config.empty() ? one_d::Config{} : one_d::readConfig(options.config);
  const one_d::Results results = one_d::runExperiment(config);
  one_d::writeResults(results, options.out);
  fmt::print("{}\nreport: {}/report.html\n", one_d::tableText(results), options.out);
}

}  // namespace

void addOneDCommand(CLI::App& app) {
  const auto options = std::make_shared<OneDOptions>();
  CLI::App* command = app.add_subcommand(
      "one-d", "The paper's one-dimensional experiment: virtual coupling against handle-space linearization");
  command->add_option("--config", options->config, "YAML file, see docs/one-d.md; default: the paper's experiment")
      ->type_name("FILE");
  command
      ->add_option("--out", options->out, "Folder for one_d.csv, summary.json and report.html")

      ->type_name("DIR")
      ->capture_default_str();
  command->callback([options] { runOneD(*options); });
}

}  // namespace palpate
