#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "palpate/haptics/haptic_loop.h"
#include "palpate/session/auto_step.h"
#include "palpate/visual/visual_step.h"

namespace palpate {

/// Who takes the rows of a run, in order of time. Each function may do nothing.
struct RunSink {
  std::function<void(const TickRecord&)> tick = [](const TickRecord&) {};
  std::function<void(const VisualRecord&)> visual = [](const VisualRecord&) {};
  /// After each visual step, on the thread that steps the world, which is the only one to see it.
  std::function<void(const World&, const VisualRecord&)> stepped = [](const World&, const VisualRecord&) {};
  std::function<void(double share)> progress = [](double) {};
  /// Asked all the time: the run is to end now. In real time the force leaves first.
  std::function<bool()> stopped = [] { return false; };
};

/// The way of the models in real time. Each that was made was overwritten, waits, or was given to the haptic loop,
/// which used or refused it, let a newer one overtake it, or still replays it.
struct ModelTraffic {
  std::uint64_t made = 0;
  std::uint64_t overwritten = 0;  ///< late: never seen by the haptic loop, as the next one came first
  ModelAccount account;           ///< the haptic loop's
  /// Neither used nor refused nor counted as late; at most two at the end of a run.
  std::uint64_t underWay() const { return made - overwritten - account.used - account.refused - account.overtaken; }
};

/// What a run as a whole says, besides its rows.
struct RunOutcome {
  TickCounters counters;
  double delivered_energy = 0;  ///< net energy given to the hand [J]
  SwitchAccount switches;       ///< of method `live`
  std::uint64_t ticks = 0;
  double end_time = 0;              ///< of the tick that would have come next [s]
  bool stopped = false;             ///< it was told to end before its time
  std::string ended_by;             ///< by whom: "SIGINT", "viewer" ...; empty: by itself, or by a failure
  std::string failure;              ///< what made it end before its time, for people; empty: nothing
  std::uint64_t missed = 0;         ///< haptic deadlines missed; 0 in lockstep
  std::uint64_t most_missed = 0;    ///< in a row
  std::uint64_t dropped_rows = 0;   ///< rows that the recording could not take in time
  std::vector<double> tick_us;      ///< p50, p99, max, p99.9 of the tick's work
  std::vector<double> wake_us;      ///< p50, p99, max, p99.9 of the wake-up latency; real time only
  std::vector<double> response_us;  ///< likewise, from a device sample to the end of its visual step; real time only
  bool realtime = false;
  std::string realtime_note;          ///< what the system refused, for people
  ModelTraffic models;                ///< real time only
  std::optional<AutoStep> auto_step;  ///< by which the visual step was chosen
};

}  // namespace palpate
