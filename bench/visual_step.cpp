// The whole visual step, linearization included, on the shipped scenes, beside one numeric factorization of A_tt by
// general-purpose libraries in the same run.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "factorization_baseline.h"
#include "palpate/common/scoped_timer.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/results/statistics.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"
#include "palpate/session/lockstep.h"
#include "threads.h"

namespace palpate {
namespace {

struct Case {
  const char* scene;
  int tetrahedra;                                          // 0: the scene's own
  bool exact;                                              // hsl-exact
  double from;                                             // steps before this time are not measured [s]
  double until = std::numeric_limits<double>::infinity();  // nor those after it [s]
  bool surfaces = false;  // only steps in which surfaces of bodies press on each other count; all on one built scene
};

// Contacts between surfaces of bodies that carry force.
int pressed(const ContactSet& set) {
  int count = 0;
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    count += set.contacts[i].second.body >= 0 && set.status[i].state != ContactState::open ? 1 : 0;
  }
  return count;
}

SceneConfig configOf(const Case& c) {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/" + c.scene + ".yaml");
  Overrides overrides;
  overrides.device = "prescribed";
  overrides.method = c.exact ? "hsl-exact" : "hsl";
  if (c.tetrahedra > 0) overrides.tetrahedra = c.tetrahedra;
  applyOverrides(config, overrides);
  return config;
}

// One iteration is one visual step of the scene's motion in which contacts carry force; the scene starts over at its
// end.
void visualStepInContact(benchmark::State& state, const Case& c) {
  const ExecutorScope threads(&benchTeam());
  const SceneConfig config = configOf(c);
  const RunTiming timing = timingOf(config);
  BuiltScene scene = buildScene(config);
  const HandleModel first = startModel(scene, timing);
  const WorldState start = scene.world.state();
  const VisualStepSettings settings = visualSettings(scene, timing);
  WorldState saved;
  std::vector<double> state_ms;  // to save the state and to restore it
  std::vector<double> total, factorize, contact, linearization, active, contacts, found, between, passes, iterations;
  double t = 0, trouble = 0;
  std::size_t before = 0;  // this run through the motion
  for (auto _ : state) {
    VisualRecord record;
    do {
      if (t >= std::min(config.duration, c.until)) {
        if (total.size() == before) {
          state.SkipWithError("the motion has no step in such contact");
          return;
        }
        before = total.size();
        scene.world.restore(start);
        t = 0;
      }
      record = visualStep(scene.world, aimAt(scene.device->sample(t), timing), settings, t, first);
      t += timing.visual_step;
    } while (t < c.from || record.step.active == 0 || (c.surfaces && pressed(scene.world.contacts()) == 0));
    double state_s = 0;
    {
      const ScopedTimer timer(state_s);
      saved = scene.world.state();
      scene.world.restore(saved);
    }
    state_ms.push_back(1e3 * state_s);
    const double seconds = record.step.times.total() + record.linearization_s;
    state.SetIterationTime(seconds);
    total.push_back(1e3 * seconds);
    factorize.push_back(1e3 * record.step.times.factorize);
    contact.push_back(1e3 * record.step.times.contact);
    linearization.push_back(1e3 * record.linearization_s);
    active.push_back(record.step.active);
    contacts.push_back(record.step.contacts);
    found.push_back(record.step.contacts_found);
    between.push_back(pressed(scene.world.contacts()));
    passes.push_back(record.step.passes);
    iterations.push_back(record.step.solver_iterations);
    trouble += record.step.status == StepStatus::ok ? 0 : 1;
  }
  const bench::FactorizationBaseline baseline = bench::measureFactorizationBaseline(scene.world.tool().system.matrix());
  state.counters["tetrahedra"] = scene.tetrahedra;
  state.counters["triangles"] = scene.surface_triangles;
  state.counters["contacts"] = percentile(contacts, 0.5);
  state.counters["active"] = percentile(active, 0.5);
  state.counters["found"] = percentile(found, 0.5);
  state.counters["between"] = percentile(between, 0.5);
  state.counters["passes"] = percentile(passes, 0.5);
  state.counters["iterations"] = percentile(iterations, 0.5);
  state.counters["not_converged"] = trouble;
  state.counters["step_ms"] = percentile(total, 0.5);
  state.counters["step_p95_ms"] = percentile(total, 0.95);
  state.counters["factorize_ms"] = percentile(factorize, 0.5);
  state.counters["contact_ms"] = percentile(contact, 0.5);
  state.counters["linearize_share"] = percentile(linearization, 0.5) / percentile(total, 0.5);
  state.counters["state_share"] = percentile(state_ms, 0.5) / percentile(total, 0.5);
  state.counters["baseline_ms"] = 1e-3 * baseline.fastest();
  state.counters["over_baseline"] = percentile(total, 0.5) / (1e-3 * baseline.fastest());
}

const std::vector<std::pair<std::string, Case>> kCases{
    {"block_288", {"block", 0, false, 0.6}},
    {"block_2592", {"block-2592", 0, false, 0.6}},
    {"block_10140", {"block-10140", 0, false, 0.6}},
    {"alien", {"alien", 0, false, 0.5}},
    {"alien_lying", {"alien-lying", 0, false, 0.5}},
    {"alien_lying_exact", {"alien-lying", 0, true, 0.5}},
    {"bunny_300", {"bunny", 0, false, 0.5}},
    {"bunny_3000", {"bunny", 3000, false, 0.5}},
    {"plug", {"plug", 0, false, 0.5}},
    {"bunnies", {"bunnies", 0, false, 3.0, 9.5, true}},
};

const bool kRegistered = [] {
  for (const auto& [name, c] : kCases) {
    auto* registered = benchmark::RegisterBenchmark(("visualStep/" + name).c_str(), visualStepInContact, c);
    registered->UseManualTime()->Unit(benchmark::kMillisecond);
    if (c.surfaces) {  // one run through the motion: such a scene takes long to build
      registered->Iterations(200);
    } else {
      registered->MinTime(1.0);
    }
  }
  return true;
}();

}  // namespace
}  // namespace palpate
