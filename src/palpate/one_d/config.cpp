#include "palpate/one_d/config.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "palpate/common/error.h"
#include "palpate/scene/document.h"
#include "palpate/scene/value.h"

namespace palpate::one_d {

namespace {

constexpr std::size_t kMaxKnots = 20000;
constexpr std::size_t kMaxVisualSteps = 100;
constexpr double kMaxRows = 5e6;  ///< ticks times runs: bounds time, memory and the size of one_d.csv

// The bounds keep every product in the step far from overflow.
const Range kMass = Range::within(1e-9, 1e9, "kg");
const Range kStiffness = Range::within(0.0, 1e12, "N/m");
const Range kDamping = Range::within(0.0, 1e12, "N s/m");
const Range kPosition = Range::within(-1e6, 1e6, "m");
const Range kTime = Range::within(0.0, 1e6, "s");
const Range kStep = Range::within(1e-6, 10.0, "s");

const std::vector<std::string> kMethods{"vc", "hsl", "live"};  // in the order of Method

void readTrajectory(const Value& value, std::vector<Knot>& knots) {
  knots.clear();
  for (const Value& item : value.items(kMaxKnots)) {
    const std::vector<Value> pair = item.items(2);
    if (pair.size() != 2) item.fail("must be a pair [time in s, position in m]");
    knots.push_back({pair[0].number(kTime), pair[1].number(kPosition)});
    const std::size_t last = knots.size() - 1;
    if (last == 0 && knots[0].t != 0.0) item.fail("the first time must be 0");
    if (last > 0 && knots[last].t - knots[last - 1].t < 1e-6) {
      item.fail("must be at least 1e-06 s later than the point before it");
    }
  }
  if (knots.size() < 2) value.fail("must have at least two points [time in s, position in m]");
}

void readVisualSteps(const Value& value, double haptic_dt, std::vector<double>& steps) {
  steps.clear();
  std::set<long long> seen;
  for (const Value& item : value.items(kMaxVisualSteps)) {
    steps.push_back(item.number(kStep));
    const long long ratio = wholeMultiple(steps.back(), haptic_dt);
    if (ratio == 0) item.fail(fmt::format("{} is not a whole multiple of haptic_dt, {} s", steps.back(), haptic_dt));
    if (!seen.insert(ratio).second) item.fail("is given twice");
  }
  if (steps.empty()) value.fail("must have at least one step");
}

void readMethods(const Value& value, std::vector<Method>& methods) {
  methods.clear();
  for (const Value& item : value.items(kMethods.size())) {
    methods.push_back(static_cast<Method>(item.choice(kMethods)));
    if (std::count(methods.begin(), methods.end(), methods.back()) > 1) item.fail("is given twice");
  }
  if (methods.empty()) value.fail("must name at least one of vc, hsl, live");
}

void readHapticStep(const Value& value, double& haptic_dt) {
  haptic_dt = value.number(kStep);
  if (wholeMultiple(Config::kReferenceDt, haptic_dt) > 0) return;
  value.fail(fmt::format("the reference's visual step of {} s must be a whole multiple of it, unlike of {} s",
                         Config::kReferenceDt, haptic_dt));
}

std::vector<Field> configFields(Config& config) {
  Parameters& p = config.parameters;
  return {
      numberField("handle_mass", p.handle_mass, kMass),
      numberField("tool_mass", p.tool_mass, kMass),
      numberField("spring_stiffness", p.spring_stiffness, kStiffness),
      numberField("spring_damping", p.spring_damping, kDamping),
      numberField("rest_length", p.rest_length, Range::within(0.0, 1e6, "m")),
      numberField("link_stiffness", p.link_stiffness, kStiffness),
      numberField("link_damping", p.link_damping, kDamping),
      {"trajectory", [&](const Value& value) { readTrajectory(value, config.trajectory); }},
      {"haptic_dt", [&](const Value& value) { readHapticStep(value, config.haptic_dt); }},
      {"visual_dts", [&](const Value& value) { readVisualSteps(value, config.haptic_dt, config.visual_dts); }},
      numberField("latency", config.latency, Range::within(0.0, 1000.0, "visual steps")),
      {"methods", [&](const Value& value) { readMethods(value, config.methods); }},
  };
}

/// What no key can check by itself, because the other may have been left out.
void checkTogether(const Config& config, const std::string& name) {
  for (const double step : config.visual_dts) {
    if (wholeMultiple(step, config.haptic_dt) > 0) continue;
    throw InputError(name, "visual_dts",
                     fmt::format("{} is not a whole multiple of haptic_dt, {} s", step, config.haptic_dt));
  }
  const double start = config.trajectory.front().x - config.parameters.rest_length;
  if (start < -1e-12) {
    throw InputError(name, "trajectory",
                     fmt::format("starts with the tool inside the wall: the first position must be at least the "
                                 "rest_length of {} m",
                                 config.parameters.rest_length));
  }
  const double runs = 1.0 + static_cast<double>(config.methods.size() * config.visual_dts.size());
  const double rows = runs * std::ceil(config.trajectory.back().t / config.haptic_dt);
  if (rows > kMaxRows) {
    throw InputError(name, "trajectory",
                     fmt::format("is too long: ticks times runs would be {:g}, the limit is {:g}", rows, kMaxRows));
  }
}

}  // namespace

std::string methodName(Method method) { return kMethods[static_cast<std::size_t>(method)]; }

long long wholeMultiple(double whole, double part) {
  const double ratio = whole / part;
  const double rounded = std::round(ratio);
  const bool is_whole = rounded >= 1.0 && rounded < 1e12 && std::abs(ratio - rounded) <= 1e-9 * rounded;
  return is_whole ? static_cast<long long>(rounded) : 0;
}

Timing timingOf(const Config& config, double visual_dt, double latency) {
  const auto period = static_cast<std::size_t>(wholeMultiple(visual_dt, config.haptic_dt));
  return {period, static_cast<std::size_t>(std::ceil(latency * static_cast<double>(period) - 1e-9))};
}

ToolState restAtStart(const Config& config) {
  const double x = config.trajectory.front().x;
  return {{x, 0.0}, {x - config.parameters.rest_length, 0.0}};
}

Config readConfig(const std::string& file) { return parseConfig(readDocumentText(file), file); }

Config parseConfig(const std::string& content, const std::string& name) {
  Config config;
  Value(name, "", parseDocument(content, name)).fields(configFields(config));
  checkTogether(config, name);
  return config;
}

}  // namespace palpate::one_d
