#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "palpate/scene/config.h"
#include "palpate/study/stress.h"

namespace palpate {

inline constexpr int kUsualRides = 10;

/// A wild hand on the scene, with its timing and seed; bodies without self-contact may pass through themselves.
StressSettings stressSettingsOf(const SceneConfig& config);

/// The content of summary.json (docs/files.md).
nlohmann::ordered_json stressSummary(const std::string& scene, const StressSettings& settings, const StressOutcome& o);

/// rides.csv, a row a ride; the longest step, which differs from run to run, `with_times` only. Throws as CsvWriter
/// does.
void writeRides(const std::filesystem::path& path, const std::vector<StressRide>& rides, bool with_times = true);

}  // namespace palpate
