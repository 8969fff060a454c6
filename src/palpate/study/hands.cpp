#include "palpate/study/hands.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/record/text_table.h"
#include "palpate/scene/builder.h"
#include "palpate/scene/text.h"
#include "palpate/session/lockstep.h"
#include "palpate/study/side_by_side.h"

namespace palpate {
namespace {

constexpr double kLargest = 1e5;  // of a hand's numbers

struct HandRun {
  WrenchTrace raw;
  Hold hold;
};

// Largest extent of some points along an axis.
class Swing {
 public:
  void add(const Vec3& x) {
    least_ = least_.cwiseMin(x);
    most_ = most_.cwiseMax(x);
  }
  double largest() const { return std::max(0.0, (most_ - least_).maxCoeff()); }

 private:
  Vec3 least_ = Vec3::Constant(1e300), most_ = Vec3::Constant(-1e300);
};

HandRun runOf(const SceneConfig& config, double from, const SideBySide::Progress& progress) {
  HandRun out;
  Swing force, position;
  BuiltScene scene = buildScene(config);
  RunSink sink;
  sink.progress = progress;
  sink.tick = [&](const TickRecord& r) {
    out.raw.push_back(r.raw);
    if (r.time < from) return;
    force.add(r.raw.head<3>());
    position.add(r.device.pose.position);
  };
  const RunOutcome outcome = runLockstep(scene, timingOf(config), sink);
  out.hold = {force.largest(), position.largest(), outcome.delivered_energy};
  return out;
}

SceneConfig inHand(SceneConfig config, const HandStiffness& hand) {
  config.device.kind = DeviceName::simulated;
  config.safety.settings.oscillation.enabled = false;  // what swings is to be seen
  config.device.hand_stiffness = hand.stiffness;
  config.device.hand_damping = hand.damping;
  if (hand.stiffness == 0 && hand.damping == 0) {
    config.device.hand_rotational_stiffness = config.device.hand_rotational_damping = 0;
  }
  return config;
}

}  // namespace

std::optional<HandStiffness> parseHand(const std::string& text) {
  if (text == "none") return HandStiffness{0, 0};
  HandStiffness hand;
  const char* const end = text.data() + text.size();
  const auto first = std::from_chars(text.data(), end, hand.stiffness);
  bool good = first.ec == std::errc() && first.ptr != end && *first.ptr == '/';
  if (good) {
    const auto second = std::from_chars(first.ptr + 1, end, hand.damping);
    good = second.ec == std::errc() && second.ptr == end;
  }
  const auto fine = [](double x) { return x >= 0 && x <= kLargest; };
  if (!good || !fine(hand.stiffness) || !fine(hand.damping)) return std::nullopt;
  return hand;
}

HandStiffness handFrom(const std::string& text) {
  if (const auto hand = parseHand(text)) return *hand;
  throw InputError("--hands", "",
                   fmt::format("{} is no hand: STIFFNESS/DAMPING in N/m and N s/m, or none", shownText(text)));
}

std::string toString(const HandStiffness& hand) {
  if (hand.stiffness == 0 && hand.damping == 0) return "none";
  return fmt::format("{:g}/{:g}", hand.stiffness, hand.damping);
}

HandStudy evaluateHands(const SceneStudy& given, const StudySettings& study, const HandsSettings& settings,
                        const std::function<void(double)>& progress) {
  HandStudy out;
  out.config = given.config;
  std::vector<KeyframeConfig>& keys = out.config.tool.chosenHandle().hand.keyframes;
  if (keys.empty()) throw InputError("--hands", out.config.name, "needs keyframes for the hand");
  const auto peak = std::max_element(given.reference.begin(), given.reference.end(), [](const Vec6& a, const Vec6& b) {
    return a.head<3>().squaredNorm() < b.head<3>().squaredNorm();
  });
  const double peak_time = static_cast<double>(peak - given.reference.begin()) * out.config.haptic_step;
  const auto last = std::min_element(keys.begin(), keys.end(), [&](const KeyframeConfig& a, const KeyframeConfig& b) {
    return std::abs(a.time - peak_time) < std::abs(b.time - peak_time);
  });
  out.hold_time = last->time;
  keys.erase(last + 1, keys.end());
  out.config.tool.chosenHandle().hand.wander = {};  // held still
  const double from = out.hold_time + settings.settle;
  out.config.duration = from + settings.watch;

  SideBySide jobs;
  std::vector<HandRun> references(settings.hands.size());
  const std::vector<Delay> delays = delaysOf(out.config, study);
  const std::size_t each = study.visual_steps.size() * study.methods.size() * delays.size();  // rows of a hand
  std::vector<HandRun> runs(settings.hands.size() * each);
  for (std::size_t h = 0; h < settings.hands.size(); ++h) {
    const HandStiffness& hand = settings.hands[h];
    const SceneConfig reference = inHand(referenceConfig(out.config), hand);
    jobs.add(out.config.duration / reference.visual_step,
             [&, h, reference](const auto& share) { references[h] = runOf(reference, from, share); });
    for (const double visual_step : study.visual_steps) {
      for (std::size_t m = 0; m < study.methods.size() * delays.size(); ++m) {
        HandRow row;
        row.hand = hand;
        row.method = study.methods[m / delays.size()];
        row.visual_step = visual_step;
        row.delay = delays[m % delays.size()];
        const SceneConfig config = inHand(variantOf(out.config, row.method, visual_step, row.delay), hand);
        HandRun& run = runs[out.rows.size()];
        jobs.add(out.config.duration / visual_step,
                 [&run, from, config](const auto& share) { run = runOf(config, from, share); });
        out.rows.push_back(std::move(row));
      }
    }
  }
  jobs.run(progress);
  for (std::size_t i = 0; i < out.rows.size(); ++i) {
    const HandRun& reference = references[i / each];
    out.rows[i].hold = runs[i].hold;
    out.rows[i].reference = reference.hold;
    out.rows[i].error = traceError(runs[i].raw, reference.raw);
    out.rows[i].reference_peak = peakForce(reference.raw);
  }
  return out;
}

nlohmann::ordered_json handsJson(const std::vector<HandStudy>& studies) {
  nlohmann::ordered_json out = nlohmann::ordered_json::array();
  for (const HandStudy& study : studies) {
    for (const HandRow& r : study.rows) {
      out.push_back({{"scene", study.config.name},
                     {"method", r.method},
                     {"visual_dt", r.visual_step},
                     {"latency", r.delay.latency},
                     {"jitter", r.delay.jitter},
                     {"hand", toString(r.hand)},
                     {"hold_s", study.hold_time},
                     {"hold_pk_N", r.hold.force},
                     {"hold_pk_mm", 1e3 * r.hold.position},
                     {"reference_hold_pk_N", r.reference.force},
                     {"reference_hold_pk_mm", 1e3 * r.reference.position},
                     {"rms_N", r.error.rms_force},
                     {"peak_error_N", r.error.peak_force},
                     {"rms_Nm", r.error.rms_torque},
                     {"reference_peak_N", r.reference_peak},
                     {"returned_J", r.hold.given},
                     {"reference_returned_J", r.reference.given}});
    }
  }
  return out;
}

std::string handTable(const std::vector<HandStudy>& studies) {
  std::vector<std::vector<std::string>> rows{{"scene", "hand", "method", "visual, ms", "latency", "swing, N",
                                              "reference", "swing, mm", "reference", "RMS, N", "given, J",
                                              "reference"}};
  std::string notes;
  for (const HandStudy& study : studies) {
    for (const HandRow& r : study.rows) {
      rows.push_back({study.config.name, toString(r.hand), r.method, fmt::format("{:g}", 1e3 * r.visual_step),
                      toString(r.delay), fmt::format("{:.4f}", r.hold.force), fmt::format("{:.4f}", r.reference.force),
                      fmt::format("{:.3f}", 1e3 * r.hold.position), fmt::format("{:.3f}", 1e3 * r.reference.position),
                      fmt::format("{:.3f}", r.error.rms_force), fmt::format("{:+.4f}", r.hold.given),
                      fmt::format("{:+.4f}", r.reference.given)});
    }
    notes += fmt::format(
        "{}: held from {:g} s on, swings peak to peak in the third second after it; reference: the same hand "
        "on vc at {:g} ms\n",
        study.config.name, study.hold_time, 1e3 * study.config.haptic_step);
  }
  return alignedColumns(rows, 3) + notes;
}

}  // namespace palpate
