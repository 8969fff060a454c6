#include "palpate/study/soak.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/scene/builder.h"
#include "palpate/session/realtime_loops.h"

namespace palpate {
namespace {

constexpr double kSpeed = 0.2, kSpin = 3.0;  // [m/s], [rad/s]

/// A simulated device that goes from hand to hand.
class ManyHands final : public SimulatedDevice {
 public:
  ManyHands(const SceneConfig& config, const Pose& start, double time)
      : SimulatedDevice(config.device, pathOf(config), start), time_(time), random_(config.seed) {}
  const char* name() const noexcept override { return "many hands"; }
  int hands() const { return hands_; }

 protected:
  Path::Point target(double t, double dt) noexcept override {
    static constexpr std::array<std::pair<double, double>, 4> kHands{{{500, 8}, {200, 3}, {100, 2}, {30, 0.5}}};
    if (t >= next_) {
      const auto& [stiffness, damping] = kHands[random_() % kHands.size()];
      takeInHand(stiffness, damping);
      next_ = t + time_;
      ++hands_;
    }
    return path().at(t + dt, startPose());
  }

 private:
  static Path pathOf(const SceneConfig& config) {
    std::vector<PathKey> keys;
    for (const KeyframeConfig& k : config.tool.chosenHandle().hand.keyframes) {
      keys.push_back({k.time, k.position, k.rotation});
    }
    return Path(std::move(keys), Interpolation::smooth);
  }
  double time_, next_ = 0;
  std::mt19937_64 random_;
  int hands_ = 0;
};

// What the process has in memory [MiB]; without a stream, whose buffers would be part of it.
double residentMemory() {
  std::ifstream stream("/proc/self/statm");
  double pages = 0, resident = 0;
  stream >> pages >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

double median(std::vector<float>::const_iterator first, std::vector<float>::const_iterator last) {
  std::vector<float> values(first, last);
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

bool isFinite(const TickRecord& r) {
  return r.sent.allFinite() && r.raw.allFinite() && r.proxy.allFinite() && r.device.pose.allFinite() &&
         !r.flags.has(TickFlag::wrench_non_finite) && !r.flags.has(TickFlag::proxy_reset) &&
         !r.flags.has(TickFlag::device_rejected);
}

bool isFinite(const VisualRecord& r) {
  return palpate::isFinite(r.model) && std::isfinite(r.step.kinetic_energy) && std::isfinite(r.step.elastic_energy);
}

void judge(const SoakSettings& settings, SoakOutcome& out) {
  const auto fail = [&](const std::string& line) { out.failures.push_back(line); };
  if (!out.run.failure.empty()) fail(out.run.failure);
  if (out.not_finite > 0) fail(fmt::format("{} ticks or steps were not finite", out.not_finite));
  constexpr double kEarly = 600;  // [s]
  if (out.memory_growth > (settings.duration < kEarly ? settings.early_limit : settings.memory_limit)) {
    fail(fmt::format("memory grows steadily, by {:.2f} MiB", out.memory_growth));
  }
  const ModelTraffic& models = out.run.models;
  const ModelAccount& account = models.account;
  const std::uint64_t settled = account.used + account.refused + account.overtaken;
  // one may wait between the loops, one be replayed
  const bool delivered = models.made - models.overwritten - account.given <= 1;
  if (!delivered || account.given - settled > 1) {
    fail(fmt::format("of {} models {} were overwritten, {} given, {} used, {} refused, {} overtaken", models.made,
                     models.overwritten, account.given, account.used, account.refused, account.overtaken));
  }
  if (out.run.dropped_rows > 0) fail(fmt::format("{} rows were lost", out.run.dropped_rows));
}

}  // namespace

SceneConfig withRandomMotion(SceneConfig config, double duration) {
  std::vector<KeyframeConfig>& keys = config.tool.chosenHandle().hand.keyframes;
  if (keys.empty()) throw InputError("soak", config.name, "needs keyframes for the hand");
  Vec3 low = Vec3::Zero(), high = Vec3::Zero(), least = Vec3::Zero(), most = Vec3::Zero();
  for (const KeyframeConfig& k : keys) {
    low = low.cwiseMin(k.position);
    high = high.cwiseMax(k.position);
    least = least.cwiseMin(k.rotation);
    most = most.cwiseMax(k.rotation);
  }
  std::mt19937_64 random(config.seed);
  const auto chance = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  const auto within = [&](const Vec3& a, const Vec3& b) {
    const double x = chance(), y = chance(), z = chance();
    return Vec3(a + Vec3(x, y, z).cwiseProduct(b - a));
  };
  keys = {KeyframeConfig{}};
  while (keys.back().time < duration) {
    const KeyframeConfig last = keys.back();
    if (chance() < 0.3) keys.push_back({last.time + 0.1 + 0.6 * chance(), last.position, last.rotation});
    KeyframeConfig next{0, within(low, high), within(least, most)};
    // minimum jerk: the fastest is 1.9 times the mean
    const double least_time =
        1.9 * std::max((next.position - last.position).norm() / kSpeed, (next.rotation - last.rotation).norm() / kSpin);
    next.time = keys.back().time + 0.05 + least_time * (1.0 + 2.0 * chance());
    keys.push_back(next);
  }
  config.tool.chosenHandle().hand.smooth = true;
  config.duration = duration;
  return config;
}

SoakOutcome runSoak(const SceneConfig& given, const SoakSettings& settings,
                    const std::function<bool(double)>& progress) {
  SceneConfig config = withRandomMotion(given, settings.duration);
  config.device.kind = DeviceName::simulated;
  BuiltScene scene = buildScene(config);
  auto device = std::make_unique<ManyHands>(config, scene.start, settings.hand_time);
  const ManyHands& hands = *device;
  scene.device = std::move(device);
  SoakOutcome out;
  std::vector<float> memory;  // one a second, taken at once: it is part of what it measures
  memory.reserve(static_cast<std::size_t>(settings.duration) + 60);
  RealtimeLoops loops(scene, timingOf(config), {});
  loops.start(1.0, settings.duration);
  TickRecord tick;
  VisualRecord step;
  bool told = false;
  for (bool last = false;;) {
    while (loops.pop(step)) {
      ++out.steps;
      if (!isFinite(step)) ++out.not_finite;
    }
    while (loops.pop(tick)) {
      if (!isFinite(tick)) ++out.not_finite;
      out.peak_force = std::max(out.peak_force, tick.sent.head<3>().norm());
      out.duration = tick.time;
    }
    if (out.duration >= static_cast<double>(memory.size()) && memory.size() < memory.capacity()) {
      memory.push_back(static_cast<float>(residentMemory()));
    }
    if (last) break;
    if (!progress(out.duration / settings.duration) && !told) {
      told = true;
      loops.askToEnd();
    }
    last = loops.ended();
    if (!last) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  std::string failure;
  try {
    loops.stop();
  } catch (const std::exception& e) {
    failure = e.what();
  }
  out.run = loops.outcome();
  out.run.failure = failure;
  out.run.stopped = told;
  out.hands = hands.hands();
  const auto at = [&](double share) {
    return memory.cbegin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(memory.size()));
  };
  std::vector<float> increments;
  for (int k = 1; k < 10; ++k) {
    const double before = 0.2 + 0.08 * (k - 1), now = 0.2 + 0.08 * k;
    increments.push_back(static_cast<float>(median(at(now), at(now + 0.08)) - median(at(before), at(now))));
  }
  out.memory_growth = 10 * median(increments.cbegin(), increments.cend());
  for (const float value : memory) out.memory_peak = std::max(out.memory_peak, static_cast<double>(value));
  for (int k = 0; k < 20 && !memory.empty(); ++k) out.memory.push_back(*at(k / 20.0));
  judge(settings, out);
  return out;
}

nlohmann::ordered_json soakJson(const std::string& scene, const SoakOutcome& o) {
  const auto spread = [](const std::vector<double>& us) {
    return nlohmann::ordered_json{{"p50", us[0]}, {"p99", us[1]}, {"p99_9", us[3]}, {"max", us[2]}};
  };
  const ModelTraffic& models = o.run.models;
  nlohmann::ordered_json flags;
  for (std::size_t k = 0; k < kTickFlagCount; ++k) {
    flags[toString(static_cast<TickFlag>(k))] = o.run.counters[static_cast<TickFlag>(k)];
  }
  return {{"scene", scene},
          {"duration_s", o.duration},
          {"ticks", o.run.ticks},
          {"missed", o.run.missed},
          {"most_missed", o.run.most_missed},
          {"steps", o.steps},
          {"hands", o.hands},
          {"peak_N", o.peak_force},
          {"not_finite", o.not_finite},
          {"models",
           {{"made", models.made},
            {"used", models.account.used},
            {"refused", models.account.refused},
            {"late", models.overwritten + models.account.overtaken},
            {"under_way", models.underWay()}}},
          {"memory_MiB", {{"growth", o.memory_growth}, {"peak", o.memory_peak}, {"series", o.memory}}},
          {"tick_us", spread(o.run.tick_us)},
          {"wake_us", spread(o.run.wake_us)},
          {"response_us", spread(o.run.response_us)},
          {"flags", flags},
          {"failures", o.failures}};
}

}  // namespace palpate
