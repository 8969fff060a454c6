#pragma once

#include <CLI/CLI.hpp>
#include <charconv>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "command_line.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"

namespace palpate {

/// What a run and a study of several methods and steps take alike.
inline void addCommonOverrides(CLI::App& command, Overrides& overrides) {
  command.add_option("--aim", overrides.aim, "What the visual handle aims at: sample or predicted")
      ->check(offers(aimNames()))
      ->type_name("NAME");
  command.add_option("--derivative", overrides.derivative, "Derivative in the handle model: frozen or full")
      ->check(offers(derivativeNames()))
      ->type_name("NAME");
  command.add_option("--handle", overrides.handle, "Which of the tool's handles is held")->type_name("NAME");
  command.add_option("--duration", overrides.duration, "Length of the run, s")->type_name("S");
  command.add_option("--latency", overrides.latency, "Visual steps until a step's result reaches the haptic loop")
      ->type_name("N");
  command.add_option("--jitter", overrides.jitter, "Visual steps that a result may be later still, by chance")
      ->type_name("N");
  command.add_option("--tetrahedra", overrides.tetrahedra, "Wanted size of the tool's simulation mesh")->type_name("N");
}

/// CLI11 would take a number beyond the largest as the largest.
inline void addSeed(CLI::App& command, std::optional<std::uint64_t>& seed, const std::string& help) {
  command
      .add_option_function<std::string>(
          "--seed",
          [&seed](const std::string& text) {
            std::uint64_t value = 0;
            const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
            if (error != std::errc() || end != text.data() + text.size()) {
              throw CLI::ValidationError("--seed", text + " is not a whole number from 0 to " +
                                                       std::to_string(std::numeric_limits<std::uint64_t>::max()));
            }
            seed = value;
          },
          help)
      ->type_name("N");
}

/// Words for --device, which takes a file behind one of them.
inline std::vector<std::string> deviceWords() {
  std::vector<std::string> out = deviceNames();
  for (std::string& name : out) {
    if (name == toString(DeviceName::recorded)) name += ':';
  }
  return out;
}

/// SCENE and what the command line may set instead of it.
struct SceneOptions {
  std::string scene;
  Overrides overrides;

  void addScene(CLI::App& command) {
    command.add_option("scene", scene, "Scene file (YAML)")->required()->type_name("SCENE");
  }

  void addOverrides(CLI::App& command) {
    command.add_option("--method", overrides.method, "live, hsl, hsl-exact or vc")
        ->check(offers(methodNames()))
        ->type_name("NAME");
    command
        .add_option_function<std::string>(
            "--visual-dt",
            [this](const std::string& text) {
              overrides.visual_auto = text == "auto";
              double step = 0;
              if (overrides.visual_auto) return;
              if (!CLI::detail::lexical_cast(text, step)) {
                throw CLI::ValidationError("--visual-dt", text + " is neither auto nor a number");
              }
              overrides.visual_dt = step;
            },
            "Length of a visual step, s, or auto: as short as this machine holds (palpate run)")
        ->type_name("S");
    addCommonOverrides(command, overrides);
    command.add_option("--cone", overrides.cone, "Friction cone: polyhedral or exact")
        ->check(offers(coneNames()))
        ->type_name("NAME");
    command
        .add_option("--device", overrides.device,
                    "simulated, prescribed, recorded:FILE, or one of palpate devices, NAME[:key=value,...]")
        ->check(offers(deviceWords()))
        ->type_name("NAME");
    addSeed(command, overrides.seed, "Of everything random: jitter, the motion of palpate stress");
  }

  SceneConfig read() const {
    SceneConfig config = readScene(scene);
    applyOverrides(config, overrides);
    return config;
  }
};

}  // namespace palpate
