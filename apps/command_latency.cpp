#include <fmt/format.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/haptics/machine.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/record/text_table.h"
#include "palpate/session/realtime_loops.h"
#include "progress.h"
#include "scene_options.h"

namespace palpate {
namespace {

constexpr int kPriority = 80;  // as the haptic loop's

struct LatencyOptions {
  std::string scene;
  std::vector<double> rates{1000, 4000};
  double duration = 5;
  std::string out;
};

struct Measured {
  double rate = 0;  // [1/s]
  PeriodicReport report;
  DurationHistogram response;  // with a scene
  RealtimeGrant grant;
};

/// Asked at each tick of a hundred, and by who waits.
bool goesOn() { return !interruptionAsked().load(); }

Measured bare(double rate, double duration, Progress& progress) {
  Measured out;
  out.rate = rate;
  std::atomic<bool> stop{false}, done{false};
  std::thread loop([&] {
    const AwakeCores awake;
    out.grant = requestRealtime(kPriority);
    runPeriodic(1.0 / rate, std::llround(duration * rate), stop, out.report, [](std::int64_t, double) { return true; });
    done = true;
  });
  const auto begin = std::chrono::steady_clock::now();
  while (!done) {
    if (!goesOn()) stop = true;
    progress(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() / duration);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  loop.join();
  return out;
}

Measured withScene(SceneConfig config, double rate, double duration, Progress& progress) {
  config.haptic_step = 1.0 / rate;
  config.duration = duration;
  BuiltScene scene = buildScene(config);
  Measured out;
  out.rate = rate;
  RealtimeLoops loops(scene, timingOf(config), {});
  loops.start(1.0, duration);
  TickRecord tick;
  VisualRecord step;
  while (!loops.ended()) {
    while (loops.pop(step)) {
    }
    while (loops.pop(tick)) progress(tick.time / duration);
    if (!goesOn()) loops.askToEnd();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  loops.stop();
  out.report = loops.report();
  out.response = loops.response();
  out.grant.core = loops.core();
  out.grant.reason = loops.realtimeNote();
  return out;
}

nlohmann::ordered_json spread(const DurationHistogram& h) {
  nlohmann::ordered_json bins = nlohmann::ordered_json::array();
  for (const DurationHistogram::Bin& bin : h.bins()) bins.push_back({bin.upper, bin.count});
  return {{"p50", h.percentile(0.5)}, {"p99", h.percentile(0.99)}, {"p99_9", h.percentile(0.999)},
          {"max", h.max()},           {"count", h.count()},        {"bins", bins}};
}

std::vector<std::string> row(double rate, const char* what, const DurationHistogram& h, std::uint64_t missed) {
  const auto us = [](double x) { return fmt::format("{:.1f}", x); };
  return {fmt::format("{:g} Hz", rate), what,        us(h.percentile(0.5)),    us(h.percentile(0.99)),
          us(h.percentile(0.999)),      us(h.max()), fmt::format("{}", missed)};
}

void latency(const LatencyOptions& options) {
  for (const double rate : options.rates) {
    if (!(rate >= 10 && rate <= 20000)) throw InputError("--rates", "", "must be 10 to 20000 Hz");
  }
  std::optional<SceneConfig> config;
  if (!options.scene.empty()) config = readScene(options.scene);
  for (const double rate : options.rates) {
    const double ticks = config ? config->visual_step * rate : 1.0;
    if (std::abs(ticks - std::round(ticks)) <= 1e-6) continue;
    throw InputError(
        "--rates", "",
        fmt::format("a visual step of {:g} s is no whole number of ticks at {:g} Hz", config->visual_step, rate));
  }
  std::optional<OutputFolder> folder;
  if (!options.out.empty()) folder.emplace(options.out);
  const InterruptionAsks asks;
  std::vector<Measured> all;
  for (const double rate : options.rates) {
    Progress progress(fmt::format("{:g} Hz for {:g} s", rate, options.duration));
    all.push_back(config ? withScene(*config, rate, options.duration, progress)
                         : bare(rate, options.duration, progress));
    if (!goesOn()) break;
  }
  bool awake = false;
  RealtimeGrant grant;
  std::thread([&] {
    awake = AwakeCores().granted();
    grant = requestRealtime(kPriority);
  }).join();
  const std::vector<std::string> advice = realtimeAdvice(grant, awake);

  std::vector<std::vector<std::string>> rows{{"rate", "us", "median", "99 %", "99.9 %", "longest", "missed"}};
  nlohmann::ordered_json summary;
  summary["scene"] = config ? config->name : "";
  for (const Measured& m : all) {
    rows.push_back(row(m.rate, "wake-up", m.report.wake_latency, m.report.missed));
    if (config) rows.push_back(row(m.rate, "tick", m.report.work, m.report.missed));
    if (config) rows.push_back(row(m.rate, "sample to visual state", m.response, m.report.missed));
    nlohmann::ordered_json j = {{"rate_hz", m.rate},
                                {"ticks", m.report.ticks},
                                {"missed", m.report.missed},
                                {"most_missed", m.report.most_missed},
                                {"core", m.grant.core},
                                {"wake_us", spread(m.report.wake_latency)},
                                {"tick_us", spread(m.report.work)}};
    if (config) j["response_us"] = spread(m.response);
    summary["rates"].push_back(j);
  }
  summary["granted"] = {{"priority", grant.scheduled}, {"memory", grant.memory_locked}, {"awake", awake}};
  summary["note"] = grant.reason;
  summary["advice"] = advice;
  summary["interrupted"] = !goesOn();
  fmt::print("{}", alignedColumns(rows, 2));
  if (!grant.reason.empty()) fmt::print("real time: {}\n", grant.reason);
  for (const std::string& line : advice) fmt::print("- {}\n", line);
  if (folder) {
    writeJson(folder->stage("summary.json"), summary);
    folder->commit();
  }
  if (!goesOn()) throw Interrupted("interrupted", interruptionSignal());
}

}  // namespace

void addLatencyCommand(CLI::App& app) {
  const auto options = std::make_shared<LatencyOptions>();
  CLI::App* command =
      app.add_subcommand("latency", "Measure how well this machine keeps a haptic loop's time, and say what to change");
  command->add_option("scene", options->scene, "Scene whose two loops run; without, a bare loop that only wakes up")
      ->type_name("SCENE");
  command->add_option("--rates", options->rates, "Rates of the loop, Hz")->delimiter(',')->capture_default_str();
  command->add_option("--duration", options->duration, "For each, s")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  command
      ->add_option("--out", options->out, "Folder for summary.json, with the histograms")

      ->type_name("DIR");
  command->callback([options] { latency(*options); });
}

}  // namespace palpate
