// Contact solver: cold, and warm from the step before, against projected Gauss-Seidel. Counters: iterations of the last
// solve, residual relative to the largest velocity, sticking contacts, slipping ones.

#include "palpate/solver/contact_solver.h"

#include <benchmark/benchmark.h>

#include "../tests/solver/contact_problems.h"

namespace palpate {
namespace {

using testing::OwnedProblem;
using testing::SoftBar;

enum Kind { nodes_25, nodes_36_sticking, points_90, points_90_flat, nodes_196, points_196, points_500 };

OwnedProblem problem(Kind kind, bool exact, bool next_step) {
  SoftBar bar;
  bar.bumpiness = kind == points_90_flat ? 0.0 : 1e-4;
  int points = 0;
  if (kind == nodes_36_sticking) {
    bar.nx = bar.ny = 6;
    bar.mu = 5.0;
    bar.drag = 0.0;
  }
  if (kind == points_90 || kind == points_90_flat) points = 90;
  if (kind == nodes_196) bar.nx = bar.ny = 14;
  if (kind == points_196 || kind == points_500) bar.nx = bar.ny = 10;
  if (kind == points_196) points = 196;
  if (kind == points_500) points = 500;
  if (kind >= nodes_196) bar.nz = 3;
  if (next_step) {
    bar.drag *= 1.03;
    bar.press *= 1.02;
  }
  return bar.make(points, points == 0, 1, {exact, 8});
}

double scale(const OwnedProblem& p) {
  return std::max(p.free.lpNorm<Eigen::Infinity>(), p.bias.lpNorm<Eigen::Infinity>());
}

void report(benchmark::State& state, const OwnedProblem& p, int iterations, const VecX& lambda,
            const std::vector<ContactStatus>& status) {
  int stick = 0, slip = 0;
  for (const ContactStatus& s : status) {
    if (s.state == ContactState::stick) {
      ++stick;
    } else if (s.state != ContactState::open) {
      ++slip;
    }
  }
  state.counters["contacts"] = p.contacts();
  state.counters["iterations"] = iterations;
  state.counters["residual"] = contactResidual(p.view(), lambda) / scale(p);
  state.counters["stick"] = stick;
  state.counters["slip"] = slip;
}

void cold(benchmark::State& state, Kind kind, bool exact) {
  const OwnedProblem p = problem(kind, exact, false);
  ContactSolver solver;
  VecX lambda;
  std::vector<ContactStatus> status;
  int iterations = 0;
  for (auto _ : state) {
    lambda.setZero(p.free.size());
    status.clear();
    iterations = solver.solve(p.view(), {}, lambda, status).iterations;
  }
  report(state, p, iterations, lambda, status);
}

void warm(benchmark::State& state, Kind kind, bool exact) {
  const OwnedProblem before = problem(kind, exact, false), p = problem(kind, exact, true);
  ContactSolver solver;
  VecX start, lambda;
  std::vector<ContactStatus> start_status, status;
  solver.solve(before.view(), {}, start, start_status);
  int iterations = 0;
  for (auto _ : state) {
    lambda = start;
    status = start_status;
    iterations = solver.solve(p.view(), {}, lambda, status).iterations;
  }
  report(state, p, iterations, lambda, status);
}

/// Projected Gauss-Seidel, the usual choice: per contact one step of 1/rho along -w and back onto the cone. Exact cone.
void projected(benchmark::State& state, Kind kind) {
  const OwnedProblem p = problem(kind, true, false);
  constexpr int limit = 2000;
  VecX lambda, w;
  int sweeps = 0;
  for (auto _ : state) {
    lambda.setZero(p.free.size());
    w = p.free;
    double change = 1.0;
    for (sweeps = 0; sweeps < limit && change > 1e-10 * scale(p); ++sweeps) {
      change = 0.0;
      for (int i = 0; i < p.contacts(); ++i) {
        const auto block = p.delassus.block<3, 3>(3 * i, 3 * i);
        const Vec3 old = lambda.segment<3>(3 * i);
        Vec3 next = old;
        next[0] = std::max(0.0, old[0] - (w[3 * i] - p.bias[i]) / block(0, 0));
        next.tail<2>() -= w.segment<2>(3 * i + 1) / block.bottomRightCorner<2, 2>().trace();
        const double length = next.tail<2>().norm(), radius = p.friction[i] * next[0];
        if (length > radius) next.tail<2>() *= radius / length;
        w.noalias() += p.delassus.middleCols<3>(3 * i) * (next - old);
        lambda.segment<3>(3 * i) = next;
        change = std::max(change, block.trace() * (next - old).norm());
      }
    }
  }
  report(state, p, sweeps, lambda, {});
}

void registerAll() {
  const std::vector<std::pair<const char*, Kind>> kinds = {{"25_nodes", nodes_25},
                                                           {"36_nodes_sticking", nodes_36_sticking},
                                                           {"90_points_on_25_nodes", points_90},
                                                           {"90_points_on_25_nodes_flat", points_90_flat},
                                                           {"196_nodes", nodes_196},
                                                           {"196_points_on_100_nodes", points_196},
                                                           {"500_points_on_100_nodes", points_500}};
  for (const auto& [name, kind] : kinds) {
    const std::string base = std::string("contact_solver/") + name;
    for (const bool exact : {false, true}) {
      const std::string cone = exact ? "/exact" : "/facets8";
      benchmark::RegisterBenchmark((base + cone + "/cold").c_str(), cold, kind, exact)->Unit(benchmark::kMillisecond);
      benchmark::RegisterBenchmark((base + cone + "/warm").c_str(), warm, kind, exact)->Unit(benchmark::kMillisecond);
    }
    benchmark::RegisterBenchmark((base + "/exact/projected_gauss_seidel").c_str(), projected, kind)
        ->Unit(benchmark::kMillisecond)
        ->Iterations(1);
  }
}

[[maybe_unused]] const bool registered = (registerAll(), true);

}  // namespace
}  // namespace palpate
