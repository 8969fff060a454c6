// Cost of one haptic tick: of its millisecond, it should take well under 1 %.
#include <benchmark/benchmark.h>

#include <random>
#include <vector>

#include "palpate/haptics/haptic_loop.h"
#include "shared/haptic_models.h"

namespace palpate {
namespace {

/// A device that goes round in a small circle, on a model that takes energy out or, with `active`, feeds it.
void hapticTick(benchmark::State& state, Rendering rendering, bool active) {
  HapticSettings settings;
  settings.rendering = rendering;
  HapticLoop loop(settings);
  loop.start(Pose{}, Pose{}, 0.0);
  std::mt19937 random(1);
  HandleModel model;
  const Mat6 root = test::randomMatrix(random, 20.0, 0.03);
  model.kx = -root * root.transpose();
  model.kv = active ? Mat6(1e3 * Mat6::Identity()) : Mat6(1e-3 * model.kx);
  std::vector<DeviceState> circle(1000);
  for (std::size_t i = 0; i < circle.size(); ++i) {
    const double angle = 2.0 * M_PI * static_cast<double>(i) / static_cast<double>(circle.size());
    circle[i].pose.position = 0.01 * Vec3(std::cos(angle), std::sin(angle), 0.0);
    circle[i].pose.rotation = Quat(Eigen::AngleAxisd(0.3 * std::sin(angle), Vec3::UnitX()));
  }
  std::size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(loop.tick(circle[i], &model, 0.0));
    i = i + 1 == circle.size() ? 0 : i + 1;
  }
  state.counters["projected"] = static_cast<double>(loop.counters()[TickFlag::stiffness_projected] > 0);
}

BENCHMARK_CAPTURE(hapticTick, hsl, Rendering::linearized, false);
BENCHMARK_CAPTURE(hapticTick, hsl_active_model, Rendering::linearized, true);
BENCHMARK_CAPTURE(hapticTick, vc, Rendering::virtual_coupling, false);

}  // namespace
}  // namespace palpate
