#include "palpate/cases/case_run.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <optional>
#include <vector>

#include "palpate/cases/files.h"
#include "palpate/cases/plan.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/results/run_files.h"
#include "palpate/scene/builder.h"
#include "palpate/scene/reader.h"
#include "palpate/session/lockstep.h"
#include "palpate/study/evaluate.h"
#include "palpate/study/hands.h"
#include "palpate/study/stress_output.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

constexpr const char* kPartial = ".partial-";

/// What a case is made of.
struct Inputs {
  Json job;
  SceneConfig scene;
  std::string digest;
};

std::vector<fs::path> filesOf(const SceneConfig& scene) {
  std::vector<fs::path> out;
  const auto add = [&](const ShapeConfig& shape) {
    if (const auto* surface = std::get_if<SurfaceShapeConfig>(&shape)) out.push_back(surface->file.path);
    if (const auto* mesh = std::get_if<TetrahedraFileShapeConfig>(&shape)) out.push_back(mesh->file.path);
  };
  add(scene.tool.shape);
  for (const FreeBodyConfig& body : scene.bodies) add(body.shape);
  for (const ObstacleConfig& obstacle : scene.obstacles)
    if (const auto* mesh = std::get_if<MeshObstacleConfig>(&obstacle.geometry)) add(mesh->shape);
  if (scene.device.recording) out.push_back(scene.device.recording->path);
  return out;
}

Inputs readInputs(const fs::path& at) {
  Inputs in;
  const std::string job = fileBytes(at / "case.json");
  std::string all = job + '\0' + fileBytes(at / "scene.yaml");
  try {
    in.job = Json::parse(job);
  } catch (const Json::exception& e) {
    throw InputError((at / "case.json").string(), "", fmt::format("is no case of a study: {}", e.what()));
  }
  in.scene = readScene(at / "scene.yaml");
  for (const fs::path& file : filesOf(in.scene)) all += '\0' + digestOf(fileBytes(file));
  in.digest = digestOf(all);
  return in;
}

/// JSON of a file; nothing where it is missing or damaged.
std::optional<Json> jsonIn(const fs::path& file) {
  std::error_code ignored;
  if (!fs::is_regular_file(file, ignored)) return std::nullopt;
  Json json = Json::parse(fileBytes(file), nullptr, false);
  if (!json.is_object()) return std::nullopt;
  return json;
}

std::string textIn(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_string() ? found->get<std::string>() : "";
}

CaseState stateOf(const fs::path& at, const std::string& digest) {
  const auto done = jsonIn(at / "result" / "done.json");
  if (done && textIn(*done, "digest") == digest) return {CaseState::Kind::done, "", textIn(*done, "program")};
  const auto failed = jsonIn(at / "failed.json");
  if (failed && textIn(*failed, "digest") == digest)
    return {CaseState::Kind::failed, textIn(*failed, "cause"), textIn(*failed, "program")};
  return {};
}

// Of this program; no more than its own bytes, so that every machine says the same.
const std::string& programDigest() {
  static const std::string digest = digestOf(fileBytes("/proc/self/exe"));
  return digest;
}

std::string hostName() {
  char name[256] = {};
  if (::gethostname(name, sizeof name - 1) != 0) return "host";
  return name;
}

/// Those of this machine whose process has ended; with `all`, everybody's.
void removePartials(const fs::path& at, bool all) {
  const std::string own = kPartial + hostName() + "-";
  std::error_code ignored;
  std::vector<fs::path> abandoned;
  for (const fs::directory_entry& entry : fs::directory_iterator(at, ignored)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(kPartial)) continue;
    const bool dead = name.starts_with(own) && ::kill(std::atoi(name.c_str() + own.size()), 0) != 0 && errno == ESRCH;
    if (all || dead) abandoned.push_back(entry.path());
  }
  for (const fs::path& path : abandoned) fs::remove_all(path, ignored);
}

/// A folder to work in, beside the result's place; gone with it unless it became the result.
class Workplace {
 public:
  explicit Workplace(const fs::path& at)
      : at_(at), path_(at / fmt::format("{}{}-{}", kPartial, hostName(), ::getpid())) {
    std::error_code failed;
    markProvisional(path_, true);
    fs::remove_all(path_, failed);
    fs::create_directory(path_, failed);
    if (failed) throw RunError(path_.string() + ": cannot make this folder: " + failed.message());
  }
  ~Workplace() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
    unmarkProvisional(path_);
  }
  Workplace(const Workplace&) = delete;
  Workplace& operator=(const Workplace&) = delete;

  const fs::path& path() const { return path_; }

  /// @param stays  whether a result that is there already is as good
  void becomeResult(const std::function<bool()>& stays) {
    const UninterruptedScope scope;
    const fs::path result = at_ / "result";
    std::error_code failed;
    fs::rename(path_, result, failed);
    if (!failed || stays()) return;
    fs::remove_all(result, failed);  // of other inputs, or not whole
    fs::rename(path_, result, failed);
    if (failed && !stays()) throw RunError(result.string() + ": cannot be put in place: " + failed.message());
  }

 private:
  fs::path at_, path_;
};

bool isTime(const std::string& key) { return key.ends_with("_ms") || key.ends_with("_us") || key == "overruns"; }

const Json& settingIn(const Json& job, const char* key) { return job.at("settings").at(key); }

void run(const Inputs& in, const fs::path& out, const std::function<void(double)>& progress) {
  const std::string tables = settingIn(in.job, "tables");
  RunFilesSettings kept;
  kept.page = false;
  kept.tables = tables == "csv" ? RunTables::csv : tables == "hdf5" ? RunTables::hdf5 : RunTables::none;
  BuiltScene scene = buildScene(in.scene);
  RunFiles files(out, in.scene, kept);
  RunSink sink = files.sink();
  sink.progress = progress;
  sink.stopped = [&] { return !files.failure().empty(); };
  const RunOutcome outcome = runLockstep(scene, timingOf(in.scene), sink);
  files.finish(scene, outcome, nullptr);
  if (!files.failure().empty()) throw RunError(files.failure());
  if (!outcome.failure.empty()) throw RunError(outcome.failure);
}

void evaluate(const Inputs& in, const fs::path& out, const std::function<void(double)>& progress) {
  StudySettings study;
  study.methods = settingIn(in.job, "methods").get<std::vector<std::string>>();
  study.visual_steps = settingIn(in.job, "visual_steps").get<std::vector<double>>();
  study.reference_check = settingIn(in.job, "reference_check");
  HandsSettings hands;
  for (const std::string hand : settingIn(in.job, "hands")) hands.hands.push_back(handFrom(hand));
  std::vector<SceneStudy> studies{evaluateScene(in.scene, study, progress)};
  std::vector<HandStudy> held;
  if (!hands.hands.empty()) held.push_back(evaluateHands(studies.front(), study, hands, progress));
  writeStudy(studies, out, handsJson(held));
  if (!settingIn(in.job, "pages").get<bool>()) fs::remove(out / "report.html");
}

/// @returns whether all criteria are met
bool stress(const Inputs& in, const fs::path& out, const std::function<void(double)>& progress) {
  StressSettings stress = stressSettingsOf(in.scene);
  const int steps = settingIn(in.job, "steps"), rides = settingIn(in.job, "rides");
  stress.riding = settingIn(in.job, "hand") == "ride";
  stress.steps = steps > 0 ? steps : stress.steps;
  stress.rides = steps > 0 ? 0 : rides > 0 ? rides : kUsualRides;
  stress.motion.speed = settingIn(in.job, "speed");
  stress.motion.spin = settingIn(in.job, "spin");
  stress.motion.ride = settingIn(in.job, "ride");
  stress.solve_static = settingIn(in.job, "static");
  BuiltScene scene = buildScene(in.scene);
  const StressOutcome outcome = runStress(scene, stress, [&](double share) {
    progress(share);
    return true;
  });
  if (stress.riding) writeRides(out / "rides.csv", outcome.rides, false);
  writeJson(out / "summary.json", stressSummary(in.scene.name, stress, outcome));
  return stressFailures(outcome).empty();
}

/// @returns whether all criteria are met
bool work(const Inputs& in, const fs::path& out, const std::function<void(double)>& progress) {
  const std::string kind = in.job.at("kind");
  if (kind == "run") {
    run(in, out, progress);
  } else if (kind == "evaluate") {
    evaluate(in, out, progress);
  } else if (kind == "stress") {
    return stress(in, out, progress);
  } else {
    throw InputError("case.json", "kind", kind + " is not known");
  }
  return true;
}

void separateTimes(const fs::path& out, double seconds) {
  Json summary = Json::parse(fileBytes(out / "summary.json"));
  Json times{{"seconds", seconds}};
  times["summary"] = takeTimes(summary);
  writeJson(out / "summary.json", summary);
  writeJson(out / "timing.json", times);
}

}  // namespace

Json takeTimes(Json& summary) {
  Json times = Json::object(), rest = Json::object();
  for (auto& [key, value] : summary.items()) {
    if (isTime(key)) {
      times[key] = std::move(value);
    } else if (value.is_object()) {
      const bool was_empty = value.empty();
      Json within = takeTimes(value);
      if (!within.empty()) times[key] = std::move(within);
      if (was_empty || !value.empty()) rest[key] = std::move(value);
    } else {
      rest[key] = std::move(value);
    }
  }
  summary = std::move(rest);
  return times;
}

CaseState caseState(const fs::path& folder, int number) {
  const fs::path at = caseFolder(folder, number);
  try {
    return stateOf(at, readInputs(at).digest);
  } catch (const InputError& e) {  // somebody has changed what was planned
    return {CaseState::Kind::failed, e.what(), ""};
  }
}

CaseOutcome runCase(const fs::path& folder, int number, bool again, const std::function<void(double)>& progress) {
  const StudyPlan plan = readPlan(folder);
  if (number < 1 || number > plan.cases())
    throw InputError(folder.string(), "", fmt::format("has no case {}; there are 1 to {}", number, plan.cases()));
  const fs::path at = caseFolder(folder, number);
  const auto begin = Clock::now();
  const Inputs in = readInputs(at);
  const auto isDone = [&] { return stateOf(at, in.digest).kind == CaseState::Kind::done; };
  if (!again && isDone()) return CaseOutcome::done_before;
  removePartials(at, false);
  bool good = true;
  try {
    Workplace place(at);
    good = work(in, place.path(), progress);
    separateTimes(place.path(), std::chrono::duration<double>(Clock::now() - begin).count());
    writeJson(place.path() / "done.json", {{"case", number}, {"digest", in.digest}, {"program", programDigest()}});
    place.becomeResult([&] { return !again && isDone(); });
  } catch (const std::exception& e) {
    if (!again && isDone()) return CaseOutcome::done_before;  // elsewhere, meanwhile
    writeJson(at / "failed.json",
              {{"case", number}, {"digest", in.digest}, {"program", programDigest()}, {"cause", e.what()}});
    throw RunError(fmt::format("case {}: {}", number, e.what()));
  }
  std::error_code ignored;
  fs::remove(at / "failed.json", ignored);
  removePartials(at, true);
  return good ? CaseOutcome::done : CaseOutcome::checks_failed;
}

}  // namespace palpate
