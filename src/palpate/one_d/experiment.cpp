#include "palpate/one_d/experiment.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>

#include "palpate/common/error.h"
#include "palpate/one_d/live.h"

namespace palpate::one_d {

namespace {

constexpr double kTimeTolerance = 1e-9;      ///< [s]
constexpr double kDragStart = 0.2;           ///< drag is measured after the run-up [s] ...
constexpr double kDragToolClearance = 0.03;  ///< ... and while the reference's tool is this far from the wall [m]

/// Ticks at i * dt from 0 up to, but not including, the end of the trajectory.
std::size_t tickCount(const Config& config) {
  const double end = config.trajectory.back().t;
  return static_cast<std::size_t>(std::max(1.0, std::ceil((end - kTimeTolerance) / config.haptic_dt)));
}

double tickTime(const Config& config, std::size_t i) { return static_cast<double>(i) * config.haptic_dt; }

/// What a visual step sends to the haptic loop, and the tick at which it arrives.
struct Message {
  std::size_t arrival = 0;
  ToolState state;
  ForceModel model;
};

/// The visual loop: steps at every period-th tick and delays the results.
class VisualLoop {
 public:
  VisualLoop(const Config& config, double visual_dt, double latency)
      : parameters_(config.parameters),
        step_(visual_dt),
        timing_(timingOf(config, visual_dt, latency)),
        state_(restAtStart(config)) {
    newest_.state = state_;
  }

  void advance(std::size_t tick, const PointState& device) {
    if (tick % timing_.period == 0) takeStep(tick, device);
    while (!underway_.empty() && underway_.front().arrival <= tick) {
      newest_ = underway_.front();
      underway_.pop_front();
      arrived_ = true;
    }
  }

  /// Null until the first result has arrived.
  const Message* newest() const { return arrived_ ? &newest_ : nullptr; }
  /// The newest state that has arrived, or the state of rest at the start.
  const ToolState& shownState() const { return newest_.state; }

 private:
  void takeStep(std::size_t tick, const PointState& device) {
    const StepResult result = visualStep(parameters_, state_, device, step_);
    underway_.push_back({tick + timing_.delay, result.state, linearize(parameters_, state_, result, step_)});
    state_ = result.state;
  }

  Parameters parameters_;
  double step_;
  Timing timing_;
  ToolState state_;
  std::deque<Message> underway_;
  Message newest_;
  bool arrived_ = false;
};

/// Methods vc and hsl: turns the newest message of the visual loop into the force on the device.
class LinkedRun {
 public:
  LinkedRun(const Config& config, Method method, double visual_dt, double latency)
      : visual_(config, visual_dt, latency), parameters_(config.parameters), method_(method), dt_(config.haptic_dt) {
    proxy_ = {config.trajectory.front().x, 0.0};
  }

  double tick(std::size_t tick, const PointState& device) {
    visual_.advance(tick, device);
    const Message* newest = visual_.newest();
    if (method_ == Method::kVc) return newest ? linkForce(parameters_, newest->state.handle, device) : 0.0;
    proxy_ = proxyTick(parameters_, newest ? &newest->model : nullptr, proxy_, device, dt_);
    return linkForce(parameters_, proxy_, device);
  }
  const ToolState& shownState() const { return visual_.shownState(); }

 private:
  VisualLoop visual_;
  Parameters parameters_;
  Method method_;
  double dt_;
  PointState proxy_;
};

void requireFinite(const Trace& trace, const std::string& method, double visual_dt) {
  const auto finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
  };
  if (finite(trace.force) && finite(trace.handle) && finite(trace.tool)) return;
  throw RunError("one-d: " + method + " at a visual step of " + std::to_string(visual_dt) +
                 " s left the finite numbers");
}

/// True for the rows on which drag is measured: free motion towards the wall, after the run-up.
std::vector<char> dragRows(const Config& config, const Trace& reference) {
  std::vector<char> rows(reference.force.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double t = tickTime(config, i);
    const bool approaching = deviceAt(config.trajectory, t).v < 0.0;
    rows[i] = t > kDragStart + kTimeTolerance && approaching && reference.tool[i] > kDragToolClearance;
  }
  return rows;
}

void measure(Run& run, const Trace& reference, const std::vector<char>& drag_rows) {
  double squares = 0.0, drag_sum = 0.0;
  std::size_t drag_count = 0;
  const std::size_t n = reference.force.size();
  for (std::size_t i = 0; i < n; ++i) {
    const double error = run.trace.force[i] - reference.force[i];
    squares += error * error;
    run.peak_error = std::max(run.peak_error, std::abs(error));
    if (drag_rows[i]) {
      drag_sum += run.trace.force[i];
      ++drag_count;
    }
  }
  run.rms = std::sqrt(squares / static_cast<double>(n));
  if (drag_count > 0) run.drag = std::abs(drag_sum / static_cast<double>(drag_count));
}

Run makeRun(const Config& config, const std::string& name, Method method, double visual_dt, double latency) {
  Run run;
  run.method = name;
  run.visual_dt = visual_dt;
  run.latency = latency;
  run.trace = simulate(config, method, visual_dt, latency);
  requireFinite(run.trace, name, visual_dt);
  return run;
}

}  // namespace

namespace {

/// @param loops  has tick(), the force on the device, and shownState()
template <class Loops>
Trace traceOf(const Config& config, Loops loops) {
  const std::size_t ticks = tickCount(config);
  Trace trace;
  for (auto* column : {&trace.device, &trace.handle, &trace.tool, &trace.force}) column->reserve(ticks);
  for (std::size_t i = 0; i < ticks; ++i) {
    const PointState device = deviceAt(config.trajectory, tickTime(config, i));
    trace.force.push_back(loops.tick(i, device));
    trace.device.push_back(device.x);
    trace.handle.push_back(loops.shownState().handle.x);
    trace.tool.push_back(loops.shownState().tool.x);
  }
  return trace;
}

}  // namespace

Trace simulate(const Config& config, Method method, double visual_dt, double latency) {
  if (method == Method::kLive) return traceOf(config, LiveRun(config, visual_dt, latency));
  return traceOf(config, LinkedRun(config, method, visual_dt, latency));
}

Results runExperiment(const Config& config) {
  Results results;
  results.config = config;
  results.reference = makeRun(config, "reference", Method::kVc, Config::kReferenceDt, 0.0);
  const Trace& reference = results.reference.trace;
  for (std::size_t i = 0; i < reference.force.size(); ++i) {
    results.time.push_back(tickTime(config, i));
    results.reference_peak = std::max(results.reference_peak, std::abs(reference.force[i]));
  }

  const std::vector<char> drag_rows = dragRows(config, reference);
  measure(results.reference, reference, drag_rows);
  for (const Method method : config.methods) {
    for (const double visual_dt : config.visual_dts) {
      results.runs.push_back(makeRun(config, methodName(method), method, visual_dt, config.latency));
      measure(results.runs.back(), reference, drag_rows);
    }
  }
  return results;
}

}  // namespace palpate::one_d
