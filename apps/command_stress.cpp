#include <fmt/format.h>

#include <csignal>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/record/csv_writer.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/study/stress.h"
#include "progress.h"
#include "scene_options.h"

namespace palpate {
namespace {

constexpr int kRides = 10;  // unless told

struct StressOptions {
  SceneOptions scene;
  std::string hand = "wild";
  std::optional<int> steps, seeds;
  StressMotion motion;
  bool solve_static = false;
  std::string out;
};

volatile std::sig_atomic_t interrupted = 0;

/// While it lives, Ctrl+C only asks to come to an end.
class InterruptAsks {
 public:
  InterruptAsks() : before_(std::signal(SIGINT, [](int) { interrupted = 1; })) {}
  ~InterruptAsks() { std::signal(SIGINT, before_); }
  InterruptAsks(const InterruptAsks&) = delete;
  InterruptAsks& operator=(const InterruptAsks&) = delete;

 private:
  void (*before_)(int);
};

StressSettings settingsOf(const StressOptions& options, const SceneConfig& config) {
  StressSettings out;
  out.timing = timingOf(config);
  out.motion = options.motion;
  out.seed = config.seed;
  out.riding = options.hand == "ride";
  out.solve_static = options.solve_static;
  if (!out.riding && options.seeds) throw InputError("--seeds", "", "needs --hand ride");
  if (!out.riding && options.solve_static) throw InputError("--static", "", "needs --hand ride");
  out.steps = options.steps.value_or(out.steps);
  out.rides = options.steps ? 0 : options.seeds.value_or(kRides);
  if (!config.tool.self_contact) out.crossable.push_back(0);
  for (std::size_t i = 0; i < config.bodies.size(); ++i) {
    if (!config.bodies[i].self_contact) out.crossable.push_back(static_cast<int>(i) + 1);
  }
  return out;
}

const char* nameOf(RideJudge judge) {
  switch (judge) {
    case RideJudge::reference:
      return "reference";
    case RideJudge::settled:
      return "static";
    default:
      return "none";
  }
}

void writeRides(const std::filesystem::path& path, const std::vector<StressRide>& rides) {
  CsvWriter csv(path, {"seed",
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
                       "energy_off_J",
                       "max_step_ms"});
  for (const StressRide& r : rides) {
    const StressTally& t = r.tally;
    csv.cell(std::to_string(r.seed)).cell(r.failed() ? 1 : 0).cell(t.steps).cell(t.deepest_penetration_rel);
    for (const int count : {t.wrong_side, t.self_intersections, t.inverted, t.restless, t.crossed, t.passed, t.folded,
                            t.nan, t.frozen, t.cut, t.cut_twice}) {
      csv.cell(count);
    }
    csv.cell(t.least_share).cell(t.redone).cell(t.not_converged).cell(t.restored).cell(t.energy_made);
    csv.cell(t.largest_energy_made).cell(t.max_energy).cell(nameOf(r.judge)).cell(r.came_back ? 1 : 0);
    csv.cell(r.handle_off).cell(r.energy).cell(r.energy_off).cell(r.max_ms);
    csv.endRow();
  }
  csv.close();
}

nlohmann::ordered_json summaryOf(const std::string& scene, const StressOptions& options, const StressSettings& settings,
                                 const StressOutcome& o) {
  const StressTally& t = o.all;
  nlohmann::ordered_json j;
  j["scene"] = scene;
  j["hand"] = options.hand;
  j["seed"] = settings.seed;
  j["step_s"] = settings.timing.visual_step;
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
    int failed = 0, judged = 0;
    nlohmann::ordered_json seeds = nlohmann::ordered_json::array();
    for (const StressRide& r : o.rides) {
      judged += r.judge == RideJudge::none ? 0 : 1;
      if (!r.failed()) continue;
      ++failed;
      seeds.push_back(r.seed);
    }
    j["restless"] = t.restless;
    j["rides"] = {{"ridden", o.rides.size()}, {"judged", judged}, {"failed", failed}, {"failed_seeds", seeds}};
  }
  return j;
}

void print(const std::string& scene, const StressSettings& settings, const StressOutcome& o) {
  const StressTally& t = o.all;
  fmt::print("{}: {} steps of {} s, seed {}", scene, t.steps, settings.timing.visual_step, settings.seed);
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
  OutputFolder folder(options.out.empty() ? "out/stress-" + config.name : options.out);
  BuiltScene scene = buildScene(config);
  StressOutcome o;
  {
    const InterruptAsks asks;
    Progress progress("stress " + config.name);
    o = runStress(scene, settings, [&](double share) {
      progress(share);
      return interrupted == 0;
    });
  }
  print(config.name, settings, o);
  if (settings.riding) writeRides(folder.stage("rides.csv"), o.rides);
  writeJson(folder.stage("summary.json"), summaryOf(config.name, options, settings, o));
  folder.commit();
  const std::vector<std::string> failures = stressFailures(o);
  for (const std::string& line : failures) fmt::print("  FAILED: {}\n", line);
  if (!failures.empty()) throw ChecksFailed(fmt::format("{}: {} criteria failed", config.name, failures.size()));
}

}  // namespace

void addStressCommand(CLI::App& app) {
  const auto options = std::make_shared<StressOptions>();
  CLI::App* command = app.add_subcommand(
      "stress", "Drive a scene with a violent random hand; exit code 3 if anything crosses, freezes or fails");
  options->scene.addScene(*command);
  options->scene.addOverrides(*command);
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
  command->add_flag("--static", options->solve_static,
                    "After a ride whose tool touches something, compare with the static solution from there");
  command->add_option("--out", options->out, "Folder for summary.json and rides.csv; default out/stress-NAME")
      ->check(kNotEmpty)
      ->type_name("DIR");
  command->callback([options] { stress(*options); });
}

}  // namespace palpate
