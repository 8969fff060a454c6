#include "palpate/one_d/experiment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>

namespace palpate::one_d {
namespace {

const Run& find(const Results& results, const std::string& method, double visual_dt) {
  const auto run = std::find_if(results.runs.begin(), results.runs.end(),
                                [&](const Run& r) { return r.method == method && r.visual_dt == visual_dt; });
  if (run == results.runs.end()) std::abort();
  return *run;
}

// Figures of an independent implementation of the same text, to all the digits that it was published with.
TEST(OneDExperiment, ReproducesTheTable) {
  const Results results = runExperiment({});
  constexpr double kHalfDigit = 0.00501;
  EXPECT_NEAR(results.reference_peak, 8.73, kHalfDigit);
  const struct {
    const char* method;
    double visual_dt, drag, rms;
  } table[] = {
      {"vc", 0.01, 5.80, 5.10}, {"vc", 0.02, 11.80, 10.32}, {"hsl", 0.01, 0.43, 0.46}, {"hsl", 0.02, 0.24, 0.60}};
  for (const auto& row : table) {
    const one_d::Run& run = find(results, row.method, row.visual_dt);
    EXPECT_NEAR(run.drag.value(), row.drag, kHalfDigit) << row.method << row.visual_dt;
    EXPECT_NEAR(run.rms, row.rms, kHalfDigit) << row.method << row.visual_dt;
  }
}

// The tool is one mode, so the tick has all of it: what the visual step adds is nothing but when it learns of the wall.
TEST(OneDExperiment, LiveIsTheFineSimulation) {
  const Results results = runExperiment({});
  for (const double visual_dt : results.config.visual_dts) {
    const one_d::Run& run = find(results, "live", visual_dt);
    EXPECT_LE(run.rms, 0.25) << visual_dt;
    EXPECT_NEAR(run.drag.value(), results.reference.drag.value(), 0.02) << visual_dt;
    const one_d::Run& hsl = find(results, "hsl", visual_dt);
    EXPECT_LT(run.rms, hsl.rms) << visual_dt;
  }
}

TEST(OneDExperiment, TwoRunsAgreeToTheBit) {
  const Results a = runExperiment({}), b = runExperiment({});
  ASSERT_EQ(a.runs.size(), b.runs.size());
  for (std::size_t i = 0; i < a.runs.size(); ++i) {
    EXPECT_EQ(a.runs[i].trace.force, b.runs[i].trace.force);
    EXPECT_EQ(a.runs[i].trace.tool, b.runs[i].trace.tool);
  }
}

TEST(OneDExperiment, TimesAreMultipliedAndNotAccumulated) {
  const Results results = runExperiment({});
  ASSERT_EQ(results.time.size(), 2600u);
  for (std::size_t i = 0; i < results.time.size(); ++i) {
    EXPECT_EQ(results.time[i], static_cast<double>(i) * 0.001);
  }
}

TEST(OneDExperiment, FirstResultsArriveAfterTheLatency) {
  const Config config;
  const Trace vc = simulate(config, Method::kVc, 0.01, 2.0);
  for (std::size_t i = 0; i < 20; ++i) EXPECT_EQ(vc.force[i], 0.0) << i;
  EXPECT_NE(vc.force[20], 0.0);
  EXPECT_EQ(vc.handle[19], 0.45);
  EXPECT_NE(vc.handle[20], 0.45);
  // The proxy is dragged from the first tick on, by its inertia alone until the first model.
  const Trace hsl = simulate(config, Method::kHsl, 0.01, 2.0);
  EXPECT_NE(hsl.force[0], 0.0);
}

TEST(OneDExperiment, WithoutLatencyTheStepCountsInItsOwnTick) {
  const Config config;
  const Parameters& p = config.parameters;
  const Trace trace = simulate(config, Method::kVc, 0.01, 0.0);
  const PointState device = deviceAt(config.trajectory, 0.0);
  const StepResult first = visualStep(p, {{0.45, 0.0}, {0.35, 0.0}}, device, 0.01);
  EXPECT_EQ(trace.force[0], linkForce(p, first.state.handle, device));
  EXPECT_EQ(trace.tool[0], first.state.tool.x);
}

TEST(OneDExperiment, LatencyOnlyDelaysWhatTheVisualLoopDoes) {
  const Config config;
  const Trace prompt = simulate(config, Method::kHsl, 0.005, 0.0);
  const Trace late = simulate(config, Method::kHsl, 0.005, 3.0);
  for (std::size_t i = 15; i < prompt.tool.size(); ++i) EXPECT_EQ(late.tool[i], prompt.tool[i - 15]);
}

TEST(OneDExperiment, ForceAtRestAgainstTheWallIsThatOfTheSprings) {
  // Held at 0.05 m, the tool at 0: spring and link in series, for every method and step.
  Config config;
  config.trajectory = {{0.0, 0.45}, {1.0, 0.05}, {4.0, 0.05}};
  const Parameters& p = config.parameters;
  const double in_series = p.spring_stiffness * p.link_stiffness / (p.spring_stiffness + p.link_stiffness);
  const Results results = runExperiment(config);
  for (const one_d::Run& run : results.runs) {
    EXPECT_NEAR(run.trace.force.back(), in_series * 0.05, 1e-6) << run.method << run.visual_dt;
    EXPECT_NEAR(run.trace.tool.back(), 0.0, 1e-12);
  }
}

TEST(OneDExperiment, DragNeedsFreeMotionTowardsTheWall) {
  Config config;
  config.trajectory = {{0.0, 0.2}, {0.5, 0.45}};
  EXPECT_FALSE(runExperiment(config).runs[0].drag.has_value());
}

TEST(OneDExperiment, TheReferenceIsItsOwnMeasure) {
  Config config;
  config.latency = 0.0;
  const Results results = runExperiment(config);
  const one_d::Run& same = find(results, "vc", 0.001);
  EXPECT_EQ(same.rms, 0.0);
  EXPECT_EQ(same.peak_error, 0.0);
  EXPECT_EQ(same.trace.force, results.reference.trace.force);
}

}  // namespace
}  // namespace palpate::one_d
