#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "palpate/scene/config.h"

namespace palpate {

/// What the command line sets instead of the scene; absent: the scene's value.
struct Overrides {
  std::optional<std::string> method{};      ///< --method: live, hsl, hsl-exact or vc
  std::optional<std::string> aim{};         ///< --aim: sample or predicted
  std::optional<std::string> derivative{};  ///< --derivative: frozen or full
  std::optional<std::string> cone{};        ///< --cone: polyhedral or exact
  std::optional<std::string> handle{};      ///< --handle: one of the tool's
  std::optional<std::string>
      device{};  ///< --device: simulated, prescribed, recorded:FILE (relative to the working folder), NAME[:options]
  std::optional<double> duration{};       ///< --duration [s]
  std::optional<double> visual_dt{};      ///< --visual-dt [s]
  bool visual_auto = false;               ///< --visual-dt auto: up to the scene's step
  std::optional<long long> latency{};     ///< --latency, visual steps
  std::optional<long long> jitter{};      ///< --jitter, visual steps
  std::optional<std::uint64_t> seed{};    ///< --seed
  std::optional<long long> tetrahedra{};  ///< --tetrahedra wanted for the tool
};

/// Changes the scene. @throws InputError (option, "", cause), e.g. "--duration"; the scene is then as it was.
void applyOverrides(SceneConfig& config, const Overrides& overrides);

}  // namespace palpate
