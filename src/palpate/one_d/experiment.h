#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/one_d/config.h"

namespace palpate::one_d {

/// One row a haptic tick; row i is at time i * haptic_dt and holds the values after that tick.
struct Trace {
  std::vector<double> device;  ///< xd [m]
  std::vector<double> handle;  ///< xh of the newest visual state that has reached the haptic loop [m]
  std::vector<double> tool;    ///< xt of the same state [m]
  std::vector<double> force;   ///< on the device [N]
};

/// One run and its errors against the reference.
struct Run {
  std::string method;      ///< "reference", "vc", "hsl" or "live"
  double visual_dt = 0.0;  ///< [s]
  double latency = 0.0;    ///< [visual steps]
  Trace trace;
  std::optional<double> drag;  ///< |mean force| in free motion towards the wall [N]; none if there is no such motion
  double rms = 0.0;            ///< root of the mean squared difference in force from the reference [N]
  double peak_error = 0.0;     ///< largest difference in force from the reference [N]
};

struct Results {
  Config config;
  std::vector<double> time;     ///< [s], for the rows of every trace
  Run reference;                ///< virtual coupling at Config::kReferenceDt, latency 0
  std::vector<Run> runs;        ///< methods in their order, visual steps in theirs
  double reference_peak = 0.0;  ///< largest |force| of the reference [N]
};

/// Runs the reference and every method at every visual step.
/// @param config  as parseConfig() checks it
/// @throws RunError if a run leaves the finite numbers
Results runExperiment(const Config& config);

/// One run in lockstep: the visual step that starts at t samples the device at t, and its result counts from the tick
/// at t + latency * visual_dt on.
Trace simulate(const Config& config, Method method, double visual_dt, double latency);

}  // namespace palpate::one_d
