#include "palpate/study/stress_output.h"

#include <nlohmann/json.hpp>

#include "palpate/record/csv_writer.h"

namespace palpate {
namespace {

const char* nameOf(RideJudge judge) {
  switch (judge) {
    case RideJudge::reference:
      return "reference";
    case RideJudge::settled:
      return "static";
    case RideJudge::swings:
      return "swings";
    default:
      return "none";
  }
}

}  // namespace

StressSettings stressSettingsOf(const SceneConfig& config) {
  StressSettings out;
  out.timing = timingOf(config);
  out.seed = config.seed;
  if (!config.tool.self_contact) out.crossable.push_back(0);
  for (std::size_t i = 0; i < config.bodies.size(); ++i) {
    if (!config.bodies[i].self_contact) out.crossable.push_back(static_cast<int>(i) + 1);
  }
  return out;
}

void writeRides(const std::filesystem::path& path, const std::vector<StressRide>& rides, bool with_times) {
  std::vector<std::string> columns{"seed",
                                   "failed",
                                   "steps",
                                   "deepest_penetration_rel",
                                   "wrong_side",
                                   "self_intersections",
                                   "inverted",
                                   "restless",
                                   "steps_crossed",
                                   "steps_passed",
                                   "steps_folded",
                                   "nan",
                                   "frozen",
                                   "cut",
                                   "cut_twice",
                                   "least_share",
                                   "redone",
                                   "not_converged",
                                   "restored",
                                   "energy_made_J",
                                   "largest_energy_made_J",
                                   "max_energy_J",
                                   "judge",
                                   "came_back",
                                   "handle_off_m",
                                   "tool_energy_J",
                                   "energy_off_J"};
  if (with_times) columns.emplace_back("max_step_ms");
  CsvWriter csv(path, columns);
  for (const StressRide& r : rides) {
    const StressTally& t = r.tally;
    csv.cell(std::to_string(r.seed)).cell(r.failed() ? 1 : 0).cell(t.steps).cell(t.deepest_penetration_rel);
    for (const int count : {t.wrong_side, t.self_intersections, t.inverted, t.restless, t.crossed, t.passed, t.folded,
                            t.nan, t.frozen, t.cut, t.cut_twice}) {
      csv.cell(count);
    }
    csv.cell(t.least_share).cell(t.redone).cell(t.not_converged).cell(t.restored).cell(t.energy_made);
    csv.cell(t.largest_energy_made).cell(t.max_energy).cell(nameOf(r.judge)).cell(r.came_back ? 1 : 0);
    csv.cell(r.handle_off).cell(r.energy).cell(r.energy_off);
    if (with_times) csv.cell(r.max_ms);
    csv.endRow();
  }
  csv.close();
}

nlohmann::ordered_json stressSummary(const std::string& scene, const StressSettings& settings, const StressOutcome& o) {
  const StressTally& t = o.all;
  nlohmann::ordered_json j;
  j["scene"] = scene;
  j["hand"] = settings.riding ? "ride" : "wild";
  j["seed"] = settings.seed;
  j["step_s"] = settings.timing.visual_step;
  j["by_clock"] = settings.by_clock;
  j["steps"] = t.steps;
  j["stopped"] = o.stopped;
  j["failures"] = stressFailures(o);
  j["deepest_penetration_rel"] = t.deepest_penetration_rel;
  j["nan"] = t.nan;
  j["wrong_side"] = t.wrong_side;
  j["self_intersections"] = t.self_intersections;
  j["inverted"] = t.inverted;
  j["steps_crossed"] = t.crossed;
  j["steps_passed"] = t.passed;
  j["steps_folded"] = t.folded;
  j["frozen"] = t.frozen;
  j["max_energy_J"] = t.max_energy;
  j["max_kinetic_J"] = t.max_kinetic;
  j["max_elastic_J"] = t.max_elastic;
  j["energy_made_J"] = t.energy_made;
  j["largest_energy_made_J"] = t.largest_energy_made;
  j["restored"] = t.restored;
  j["not_converged"] = t.not_converged;
  j["cut"] = t.cut;
  j["cut_twice"] = t.cut_twice;
  j["least_share"] = t.least_share;
  j["redone"] = t.redone;
  j["step_ms"] = {{"median", o.median_ms}, {"p99", o.p99_ms}, {"p99_9", o.p99_9_ms}, {"max", o.max_ms}};
  if (settings.riding) {
    int failed = 0, judged = 0, swinging = 0;
    nlohmann::ordered_json seeds = nlohmann::ordered_json::array();
    for (const StressRide& r : o.rides) {
      judged += r.judge == RideJudge::none ? 0 : 1;
      swinging += r.judge == RideJudge::swings ? 1 : 0;
      if (!r.failed()) continue;
      ++failed;
      seeds.push_back(r.seed);
    }
    j["restless"] = t.restless;
    j["rides"] = {{"ridden", o.rides.size()},
                  {"judged", judged},
                  {"swinging", swinging},
                  {"failed", failed},
                  {"failed_seeds", seeds}};
  }
  return j;
}

}  // namespace palpate
