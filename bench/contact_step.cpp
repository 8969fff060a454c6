// What contact costs in a visual step: against the number of surface triangles, with simulation meshes that stay the
// same, and against the number of contacts, with a tool that stays the same. The linearization is not included.
#include <benchmark/benchmark.h>

#include <chrono>
#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "palpate/results/statistics.h"
#include "palpate/simulation/world.h"
#include "shared/contact_scenes.h"
#include "threads.h"

namespace palpate {
namespace {

constexpr double kStep = 0.033;
constexpr int kSteps = 100;  // measured

// Presses down by `depth` and then goes on round a small horizontal circle.
class PressAndRub {
 public:
  PressAndRub(const Pose& start, double depth, double radius) : start_(start), depth_(depth), radius_(radius) {}
  DeviceTarget next() {
    constexpr int kPress = 20, kRound = 40;  // steps
    const int n = ++step_;
    DeviceTarget target{start_, Vec6::Zero()};
    target.pose.position.z() -= depth_ * std::min(1.0, static_cast<double>(n) / kPress);
    if (n <= kPress) {
      target.twist.z() = -depth_ / (kPress * kStep);
      return target;
    }
    const double rate = 2 * std::numbers::pi / kRound, angle = rate * (n - kPress);
    target.pose.position += radius_ * Vec3(std::sin(angle), 1 - std::cos(angle), 0);
    target.twist.head<3>() = radius_ * rate / kStep * Vec3(std::cos(angle), std::sin(angle), 0);
    return target;
  }
  static constexpr int kWarmUp = 30;

 private:
  Pose start_;
  double depth_, radius_;
  int step_ = 0;
};

// Medians over the steps of a run.
class Medians {
 public:
  void add(const std::string& name, double value) { values_[name].push_back(value); }
  void add(const StepReport& report) {
    add("contacts", report.contacts);
    add("active", report.active);
    add("found", report.contacts_found);
    add("passes", report.passes);
    add("iterations", report.solver_iterations);
    add("step_ms", 1e3 * report.times.total());
    add("contact_ms", 1e3 * report.times.contact);
    add("factorize_ms", 1e3 * report.times.factorize);
    residual_ = std::max(residual_, report.solver_residual);
    not_converged_ += report.status == StepStatus::ok ? 0 : 1;
  }
  void report(benchmark::State& state) const {
    for (const auto& [name, values] : values_) state.counters[name] = percentile(values, 0.5);
    state.counters["max_residual"] = residual_;
    state.counters["not_converged"] = not_converged_;
  }

 private:
  std::map<std::string, std::vector<double>> values_;
  double residual_ = 0, not_converged_ = 0;
};

// --- triangles

// Surface of a ball of about so many triangles.
Surface ball(int triangles) {
  double cell = test::kBallRadius * std::sqrt(6 * std::numbers::pi * 2 / triangles);
  Surface surface;
  for (int trial = 0; trial < 3; ++trial) {
    surface = test::ballSurface(cell);
    cell *= std::sqrt(static_cast<double>(surface.triangles.size()) / triangles);
  }
  return surface;
}

// The same lattice of about 1,000 tetrahedra for every surface.
SimulationMesh softBall(int triangles) {
  static const double cell_size = [] {
    EmbedOptions options;
    options.target_tetrahedra = 1000;
    EmbedReport report;
    embedSurface(ball(5000), options, &report);
    return report.cell_size;
  }();
  EmbedOptions options;
  options.cell_size = cell_size;
  return embedSurface(ball(triangles), options);
}

// Two soft balls without weight, one held by its top and pressed on the other and rubbed round; the other is held by
// its bottom, by a handle too heavy to move.
void stepAgainstTriangles(benchmark::State& state) {
  const ExecutorScope threads(&benchTeam());
  const SimulationMesh mesh = softBall(static_cast<int>(state.range(0)));
  test::BallOptions options;
  options.offset.z() += 2 * test::thicknessOf(mesh);
  options.lower_handle = 1e6;
  World world = test::ballOverBall(mesh, options);
  SurfaceContacts apart;  // for timing the finding alone
  apart.addBody(0, test::moved(mesh, {options.offset, Quat::Identity()}), false);
  apart.addBody(1, mesh, false);
  FrictionTable friction;
  friction.setBody(0, 0.5);
  friction.setBody(1, 0.5);
  PressAndRub hand(world.tool().state.handle.pose, 0.02, 0.005);
  for (int n = 0; n < PressAndRub::kWarmUp; ++n) benchmark::DoNotOptimize(world.step(hand.next(), kStep));

  std::vector<Contact> found;
  Medians medians;
  for (auto _ : state) {
    const StepReport report = world.step(hand.next(), kStep);
    state.SetIterationTime(report.times.contact);
    medians.add(report);
    for (int b = 0; b < 2; ++b) apart.setStart(b, world.body(b).system.startPositions());
    found.clear();
    const auto begin = std::chrono::steady_clock::now();
    for (int b = 0; b < 2; ++b) apart.setEnd(b, world.body(b).state.positions);
    apart.find(world.contact, friction, found);
    const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - begin;
    medians.add("find_ms", elapsed.count());
    medians.add("candidates", static_cast<double>(found.size()));
  }
  medians.report(state);
  state.counters["triangles"] = static_cast<double>(mesh.surface.triangles.size());
  state.counters["tetrahedra"] = static_cast<double>(mesh.mesh.tetrahedra.size());
}

// --- contacts

// A soft plate of 5 mm cells, held by its upper side, pressed on a fixed block with a square top and rubbed on it. The
// n^2 vertices of the plate that are over the block are contacts; along the block's outline come about 3 n more.
// Argument: contacts wanted.
void stepAgainstContacts(benchmark::State& state) {
  const ExecutorScope threads(&benchTeam());
  const auto side = static_cast<int>(std::lround(std::sqrt(static_cast<double>(state.range(0)) + 2.25) - 1.5));
  // with an even number of vertices on a side the block is between two columns
  World world = test::plateOverBlock(24, side, side % 2 == 0 ? 0.5 : 0.0);
  PressAndRub hand(world.tool().state.handle.pose, 0.002, 0.001);
  for (int n = 0; n < PressAndRub::kWarmUp; ++n) benchmark::DoNotOptimize(world.step(hand.next(), kStep));
  Medians medians;
  for (auto _ : state) {
    const StepReport report = world.step(hand.next(), kStep);
    state.SetIterationTime(report.times.total());
    medians.add(report);
  }
  medians.report(state);
  state.counters["tetrahedra"] = static_cast<double>(world.tool().model.mesh().mesh.tetrahedra.size());
}

// Soft blocks of 48 tetrahedra side by side that slide down an incline, nine vertices of each on it: contacts that have
// nothing to do with each other, but for blocks' own. Argument: contacts wanted.
void stepAgainstBodies(benchmark::State& state) {
  const ExecutorScope threads(&benchTeam());
  const int blocks = static_cast<int>(state.range(0)) / 10;
  World world = test::slidingBlocks(blocks);
  const DeviceTarget nobody;
  for (int n = 0; n < PressAndRub::kWarmUp; ++n) benchmark::DoNotOptimize(world.step(nobody, kStep));
  Medians medians;
  for (auto _ : state) {
    const StepReport report = world.step(nobody, kStep);
    state.SetIterationTime(report.times.total());
    medians.add(report);
  }
  medians.report(state);
  state.counters["bodies"] = blocks;
}

BENCHMARK(stepAgainstTriangles)
    ->Arg(5000)
    ->Arg(20000)
    ->Arg(70000)
    ->Iterations(kSteps)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(stepAgainstContacts)->Arg(10)->Arg(100)->Iterations(kSteps)->UseManualTime()->Unit(benchmark::kMillisecond);
// most of a second a step
BENCHMARK(stepAgainstContacts)->Arg(500)->Iterations(20)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(stepAgainstBodies)
    ->Arg(10)
    ->Arg(100)
    ->Arg(500)
    ->Iterations(kSteps)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate
