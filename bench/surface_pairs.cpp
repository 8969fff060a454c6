// Collision geometry of two spheres of 10 cm that touch: refitting the boxes and finding the pairs, apart. Argument:
// the triangles of each sphere.
#include <benchmark/benchmark.h>

#include <cmath>
#include <map>
#include <vector>

#include "palpate/contact/overlap.h"
#include "palpate/contact/surface_pairs.h"

namespace palpate {
namespace {

constexpr double kRadius = 0.05;
constexpr double kReach = 4e-4;

// Rings of triangles about z: 4 m (m + 1) of them, nearly alike in size except near the poles.
Surface ringSphere(int triangles) {
  const int rings = static_cast<int>(std::sqrt(triangles / 4.0)), around = 2 * rings;
  Surface s;
  s.vertices.emplace_back(0, 0, kRadius);
  for (int i = 1; i <= rings; ++i)
    for (int j = 0; j < around; ++j) {
      const double polar = 3.14159265358979 * i / (rings + 1),
                   turn = 2 * 3.14159265358979 * (j + 0.5 * (i % 2)) / around;
      s.vertices.push_back(kRadius *
                           Vec3(std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn), std::cos(polar)));
    }
  s.vertices.emplace_back(0, 0, -kRadius);
  const auto at = [&](int ring, int j) { return 1 + ring * around + j % around; };
  const int last = static_cast<int>(s.vertices.size()) - 1;
  for (int j = 0; j < around; ++j) {
    s.triangles.push_back({0, at(0, j), at(0, j + 1)});
    s.triangles.push_back({last, at(rings - 1, j + 1), at(rings - 1, j)});
  }
  for (int i = 0; i + 1 < rings; ++i)
    for (int j = 0; j < around; ++j) {
      const int shift = i % 2;  // the ring below is half a step ahead, or behind
      s.triangles.push_back({at(i, j), at(i + 1, j + shift), at(i, j + 1)});
      s.triangles.push_back({at(i, j), at(i + 1, j + shift + around - 1), at(i + 1, j + shift)});
    }
  return s;
}

struct Scene {
  CollisionSurface left, right;
};

// Side by side along x, where the triangles are even; the right one pressed flat against the left, so that about 2 cm^2
// face each other at 0.3 mm, and moving by `motion`.
Scene scene(int triangles, const Vec3& motion) {
  static std::map<int, CollisionSurface> made;
  if (!made.contains(triangles)) made.emplace(triangles, CollisionSurface(ringSphere(triangles)));
  Scene s{made.at(triangles), made.at(triangles)};
  const double flat = kRadius - 6.6e-4;  // a cap of 2 cm^2 is cut off
  for (size_t i = 0; i < s.left.rest().size(); ++i) {
    Vec3 &l = s.left.start[i], &r = s.right.start[i];
    l.x() = std::min(l.x(), flat);
    r.x() = std::max(r.x(), -flat);
    r.x() += 2 * flat + 3e-4;
    s.left.end[i] = l;
    s.right.end[i] = r + motion;
  }
  s.left.refit();
  s.right.refit();
  return s;
}

void refit(benchmark::State& state) {
  Scene s = scene(static_cast<int>(state.range(0)), Vec3(-2e-4, 5e-4, 0));
  for (auto _ : state) {
    s.left.refit();
    s.right.refit();
  }
  state.counters["triangles"] = static_cast<double>(s.left.triangles().size());
}

void findPairs(benchmark::State& state, const Vec3& motion) {
  Scene s = scene(static_cast<int>(state.range(0)), motion);
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
  Scene s = scene(static_cast<int>(state.range(0)), Vec3::Zero());
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
