// Collision geometry of two spheres of 10 cm that touch: refitting the boxes and finding the pairs, apart. Argument:
// the triangles of each sphere.
#include <benchmark/benchmark.h>

#include <vector>

#include "palpate/contact/overlap.h"
#include "palpate/contact/surface_pairs.h"
#include "shared/pressed_spheres.h"

namespace palpate {
namespace {

constexpr double kReach = 4e-4;

void refit(benchmark::State& state) {
  testing::PressedSpheres s = testing::pressedSpheres(static_cast<int>(state.range(0)), Vec3(-2e-4, 5e-4, 0));
  for (auto _ : state) {
    s.left.refit();
    s.right.refit();
  }
  state.counters["triangles"] = static_cast<double>(s.left.triangles().size());
}

void findPairs(benchmark::State& state, const Vec3& motion) {
  testing::PressedSpheres s = testing::pressedSpheres(static_cast<int>(state.range(0)), motion);
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs;
  for (auto _ : state) {
    state.PauseTiming();  // refitting makes the finder ask for triangles' boxes anew, as in every step
    s.left.refit();
    s.right.refit();
    state.ResumeTiming();
    pairs.clear();
    finder.find(s.left, s.right, kReach, pairs);
  }
  double hits = 0;
  for (const auto& p : pairs) hits += p.hit ? 1 : 0;
  state.counters["triangles"] = static_cast<double>(s.left.triangles().size());
  state.counters["pairs"] = static_cast<double>(pairs.size());
  state.counters["hits"] = hits;
}

void findResting(benchmark::State& state) { findPairs(state, Vec3::Zero()); }
void findSliding(benchmark::State& state) { findPairs(state, Vec3(-1e-4, 5e-4, 0)); }
void findPressing(benchmark::State& state) { findPairs(state, Vec3(-1e-3, 5e-4, 0)); }
void findThrown(benchmark::State& state) { findPairs(state, Vec3(-0.066, 0, 0)); }

void overlaps(benchmark::State& state) {
  testing::PressedSpheres s = testing::pressedSpheres(static_cast<int>(state.range(0)), Vec3::Zero());
  for (Vec3& p : s.right.start) p.x() -= 1e-3;
  std::vector<OverlapPoint> points;
  for (auto _ : state) {
    state.PauseTiming();
    s.right.refit();
    state.ResumeTiming();
    points.clear();
    findOverlaps(s.left, s.right, points);
  }
  state.counters["points"] = static_cast<double>(points.size());
}

BENCHMARK(refit)->Arg(5000)->Arg(20000)->Arg(70000)->Unit(benchmark::kMillisecond);
BENCHMARK(findResting)->Arg(5000)->Arg(20000)->Arg(70000)->Unit(benchmark::kMillisecond);
BENCHMARK(findSliding)->Arg(5000)->Arg(20000)->Arg(70000)->Unit(benchmark::kMillisecond);
BENCHMARK(findPressing)->Arg(5000)->Arg(20000)->Arg(70000)->Unit(benchmark::kMillisecond);
BENCHMARK(findThrown)->Arg(5000)->Arg(20000)->Arg(70000)->Unit(benchmark::kMillisecond);
BENCHMARK(overlaps)->Arg(5000)->Arg(20000)->Arg(70000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate
