#include "palpate/session/lockstep.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "palpate/scene/hardware.h"
#include "palpate/scene/reader.h"
#include "palpate/session/auto_step.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

std::vector<TickRecord> ticksOf(MethodName method, int latency, int jitter, std::uint64_t seed = 1) {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/cube.yaml");
  config.method = method;
  config.duration = 1.5;
  config.latency = latency;
  config.jitter = jitter;
  config.seed = seed;
  BuiltScene scene = buildScene(config);
  std::vector<TickRecord> ticks;
  RunSink sink;
  sink.tick = [&](const TickRecord& r) { ticks.push_back(r); };
  runLockstep(scene, timingOf(config), sink);
  return ticks;
}

// A result counts `latency` to `latency` + `jitter` visual steps after its step began; the oldest in use is one step
// older, and no result is followed by an earlier one.
TEST(Lockstep, JitterDelaysResultsByChance) {
  constexpr double step = 0.033, tick = 0.001;
  for (const int jitter : {0, 1, 2}) {
    double youngest = 1, oldest = 0, newest = -1;
    for (const TickRecord& r : ticksOf(MethodName::hsl, 1, jitter)) {
      if (r.time < 8 * step) continue;  // until then it is the start's
      const double made = r.time - r.model_age;
      EXPECT_GE(made, newest - 1e-9);
      newest = made;
      youngest = std::min(youngest, r.model_age);
      oldest = std::max(oldest, r.model_age);
    }
    EXPECT_GE(youngest, step - 1e-9);
    EXPECT_LE(youngest, jitter > 0 ? (1 + jitter) * step : step + 1e-9);
    EXPECT_LE(oldest, (2 + jitter) * step - tick + 1e-9);
    EXPECT_GE(oldest, jitter > 0 ? (2 + 0.3 * jitter) * step : 2 * step - tick - 1e-9);
  }
}

// A hand that is 10 cm too deep presses with what its device can render, not with 70 N.
TEST(Lockstep, TheLinkPressesWithNoMoreThanItsLimit) {
  for (const MethodName method : {MethodName::live, MethodName::hsl}) {
    SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/cube.yaml");
    config.method = method;
    config.duration = 3;
    config.tool.material.youngs_modulus = 1e5;
    config.tool.chosenHandle().hand.keyframes = {{0.0}, {1.0}, {4.0}};
    for (const int k : {1, 2}) config.tool.chosenHandle().hand.keyframes[k].position = Vec3(0, 0, -0.1);
    config.device.limits = DeviceLimits{};
    BuiltScene scene = buildScene(config);
    const double weight = scene.world.tool().model.totalMass() * 9.81;
    EXPECT_NEAR(scene.world.link.peak_force, config.device.limits.peak_force + weight, 1e-9);
    runLockstep(scene, timingOf(config), {});
    const double force = test::contactForce(scene.world, scene.world.toolIndex()).total.z();
    EXPECT_NEAR(force, scene.world.link.peak_force + weight, 0.01 * force);
  }
}

TEST(Lockstep, JitterFollowsTheSeed) {
  const auto ages = [](std::uint64_t seed) {
    std::vector<double> out;
    for (const TickRecord& r : ticksOf(MethodName::hsl, 1, 2, seed)) out.push_back(r.model_age);
    return out;
  };
  EXPECT_EQ(ages(1), ages(1));
  EXPECT_NE(ages(1), ages(2));
}

// A live model is replayed to the tick in which it comes: its age is felt little.
TEST(Lockstep, LiveForceHardlyKnowsOfJitter) {
  const std::vector<TickRecord> even = ticksOf(MethodName::live, 1, 0), late = ticksOf(MethodName::live, 1, 2);
  double squares = 0, peak = 0;
  for (std::size_t i = 0; i < even.size(); ++i) {
    squares += (even[i].raw - late[i].raw).head<3>().squaredNorm();
    peak = std::max(peak, even[i].raw.head<3>().norm());
  }
  EXPECT_GT(peak, 1.0);
  EXPECT_LT(std::sqrt(squares / static_cast<double>(even.size())), 0.02 * peak);
}

/// A device on a desk that only counts.
class CountedDriver final : public DeviceDriver {
 public:
  const DriverInfo& info() const noexcept override { return info_; }
  bool read(DriverSample&) noexcept override { return ++calls > 0; }
  void write(const Vec6&) noexcept override { ++calls; }
  void release() noexcept override { ++calls; }
  int calls = 0;

 private:
  DriverInfo info_;
};

// The warm-up runs faster than time: a person's device must not be moved along.
TEST(AutoStep, DoesNotReachADeviceOnADesk) {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/cube.yaml");
  config.duration = 0.2;
  const auto driver = std::make_shared<CountedDriver>();
  config.device.kind = DeviceName::inverse3;
  config.device.driver = driver;
  openDevice(config);
  const AutoStep chosen = chooseVisualStep(config, 0.2);
  EXPECT_GT(chosen.cost_s, 0.0);
  EXPECT_EQ(driver->calls, 0);
}

TEST(OpenDevice, GatesTheStartUnlessTheSceneSaysOtherwise) {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/cube.yaml");
  config.device.kind = DeviceName::inverse3;
  config.device.driver = std::make_shared<CountedDriver>();
  SceneConfig ungated = config;
  ungated.safety.start_gate = false;
  openDevice(config);
  openDevice(ungated);
  EXPECT_TRUE(config.safety.settings.presence.start_gate);
  EXPECT_FALSE(ungated.safety.settings.presence.start_gate);
}

}  // namespace
}  // namespace palpate
