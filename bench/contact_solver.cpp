// Contact solver: cold, and warm from the step before, against other methods (contact_rivals.h). Counters: iterations
// of the last solve, residual relative to the largest velocity, sticking contacts, slipping ones.

#include "palpate/friction/contact_solver.h"

#include <benchmark/benchmark.h>

#include <algorithm>

#include "shared/contact_rivals.h"
#include "shared/coupled_problems.h"

namespace palpate {
namespace {

using test::CoupledProblem;
using test::CoupledScene;
using test::Coupling;
using test::OwnedProblem;
using test::SoftBar;

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

enum class Method { palpate, warm, gauss_seidel, gradient, newton, anticipation };

/// Coupled bodies: the solver, cold and warm, and other methods to a residual of 1e-8 or their limit; counters as
/// above.
void coupled(benchmark::State& state, Coupling kind, int contacts, bool exact, Method method) {
  CoupledScene scene;
  scene.kind = kind;
  scene.contacts = contacts;
  const CoupledProblem before = scene.make({exact, 8});
  if (method == Method::warm) {
    scene.drag *= 1.03;
    scene.press *= 1.02;
  }
  const CoupledProblem p = scene.make({exact, 8});
  constexpr double accuracy = 1e-8;
  // so that no method takes much more than a second or two at 500 contacts
  const int sweeps = std::clamp(200000000 / (contacts * contacts), 1000, 5000);
  ContactSolver solver;
  rivals::Outcome o;
  VecX start;
  std::vector<ContactStatus> start_status, status;
  if (method == Method::warm) solver.solve(before.view(), {}, start, start_status);
  for (auto _ : state) {
    switch (method) {
      case Method::palpate:
      case Method::warm:
        o.lambda = start;
        status = start_status;
        o.iterations = solver.solve(p.view(), {}, o.lambda, status).iterations;
        break;
      case Method::gauss_seidel:
        o = rivals::projectedGaussSeidel(p.view(), accuracy, sweeps);
        break;
      case Method::gradient:
        o = rivals::acceleratedProjectedGradient(p.view(), accuracy, sweeps);
        break;
      case Method::newton:
        o = rivals::nonsmoothNewton(p.view(), accuracy, contacts > 200 ? 10 : 50);
        break;
      case Method::anticipation:
        o = rivals::constraintAnticipation(p.view(), p.system, p.jacobian, p.momentum, accuracy, sweeps / 5);
        break;
    }
  }
  report(state, p, o.iterations, o.lambda, status);
}

void registerCoupled() {
  const std::vector<std::pair<const char*, Method>> methods = {{"cold", Method::palpate},
                                                               {"warm", Method::warm},
                                                               {"projected_gauss_seidel", Method::gauss_seidel},
                                                               {"projected_gradient", Method::gradient},
                                                               {"nonsmooth_newton", Method::newton},
                                                               {"constraint_anticipation", Method::anticipation}};
  for (const auto& [kind, kind_name] : test::allCouplings()) {
    for (const int contacts : {10, 100, 500}) {
      for (const bool exact : {false, true}) {
        for (const auto& [method_name, method] : methods) {
          if (method == Method::gradient && !exact) continue;
          const std::string name = std::string("coupled/") + kind_name + "/" + std::to_string(contacts) +
                                   (exact ? "/exact/" : "/facets8/") + method_name;
          auto* b = benchmark::RegisterBenchmark(name.c_str(), coupled, kind, contacts, exact, method);
          b->Unit(benchmark::kMillisecond);
          if (contacts >= 100) b->Iterations(1);
        }
      }
    }
  }
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
  }
  registerCoupled();
}

[[maybe_unused]] const bool registered = (registerAll(), true);

}  // namespace
}  // namespace palpate
