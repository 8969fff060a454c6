// Contact reduction on the scanned bunny pressed onto the ground: every surface point as a contact against the reduced
// set. Counters: total normal force, deepest penetration, contacts, and the norm of Kx's force block for both models of
// the Delassus matrix.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "palpate/linearization/linearize.h"
#include "shared/bunny.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

const SimulationMesh& bunny(int tetrahedra) {
  static std::map<int, SimulationMesh> meshes;
  const auto [at, fresh] = meshes.try_emplace(tetrahedra);
  if (fresh) at->second = test::standingBunny(tetrahedra);
  return at->second;
}

World heldBunny(int tetrahedra) {
  BodyModel body("bunny", bunny(tetrahedra), Material{});
  double top = 0;
  for (const Vec3& p : body.mesh().mesh.nodes) top = std::max(top, p.z());
  test::holdNodes(
      body, [&](const Vec3& p) { return p.z() >= 0.75 * top; }, test::kPlainHandle);
  World world;
  world.obstacles.push_back({PlaneShape{}, 0.5, "ground"});
  world.add(std::move(body));
  return world;
}

void contactReduction(benchmark::State& state) {
  if (!std::filesystem::exists(test::kBunnyFile)) {
    state.SkipWithError("needs Debian's package glmark2-data");
    return;
  }
  constexpr double h = 0.02;
  World world = heldBunny(static_cast<int>(state.range(0)));
  DeviceTarget target{world.tool().state.handle.pose, Vec6::Zero()};
  for (int n = 0; n < 20; ++n) {  // pressed 3 mm
    target.pose.position.z() -= 0.003 / 20;
    benchmark::DoNotOptimize(world.step(target, h));
  }
  world.contact.reduction = state.range(1) != 0;
  StepReport report;
  for (auto _ : state) report = world.step(target, h);
  double normal = 0;
  for (Eigen::Index i = 0; i < world.contacts().impulse.size(); i += 3) normal += world.contacts().impulse[i] / h;
  const auto stiffness = [&](DelassusModel model) {
    return Mat3(linearize(world, {model, Derivative::frozen}, 0.0).kx.topLeftCorner<3, 3>()).norm();
  };
  state.counters["contacts"] = report.contacts;
  state.counters["active"] = report.active;
  state.counters["normal_N"] = normal;
  state.counters["penetration_um"] = 1e6 * report.penetration;
  state.counters["kx_hsl"] = stiffness(DelassusModel::diagonal);
  state.counters["kx_exact"] = stiffness(DelassusModel::exact);
  state.counters["converged"] = report.status == StepStatus::ok ? 1 : 0;
}
BENCHMARK(contactReduction)
    ->ArgNames({"tetrahedra", "reduced"})
    ->ArgsProduct({{300, 3000}, {1}})
    ->Iterations(20)
    ->Unit(benchmark::kMillisecond);
// all points: seconds a step
BENCHMARK(contactReduction)
    ->ArgNames({"tetrahedra", "reduced"})
    ->ArgsProduct({{300, 3000}, {0}})
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate
