#pragma once

#include "palpate/scene/builder.h"
#include "palpate/session/run_record.h"

namespace palpate {

/// Timing of a run, from the scene's settings.
struct RunTiming {
  double duration = 10;
  double haptic_step = 0.001;
  double visual_step = 0.033;
  int latency = 1;
  bool predicted_aim = false;
  int substeps = 1;            ///< parts in which a visual step is taken
  bool substeps_auto = false;  ///< in real time as many as fit the visual step; in lockstep `substeps`
};
RunTiming timingOf(const SceneConfig& config);

/// What the visual handle aims at, from a device sample.
DeviceTarget aimAt(const DeviceState& device, const RunTiming& timing);

/// One visual step and its handle model: the six steps of the paper's algorithm (section 3.4).
/// With substeps the derivatives are still those of one step of length h, their horizon; force and motion are those of
/// the finer steps. That costs one step more.
/// @param previous  model of the step before, which stays in force if this step fails; its age then tells the watchdog
VisualRecord visualStep(World& world, const DeviceTarget& target, const LinearizationSettings& settings, double h,
                        double time, const HandleModel& previous, int substeps = 1);

/// How many substeps fit a visual step, from the time that the last ones took.
class SubstepBudget {
 public:
  explicit SubstepBudget(const RunTiming& timing) : timing_(timing), substeps_(timing.substeps) {}
  int substeps() const { return substeps_; }
  /// @param seconds  that a visual step with substeps() took, linearization included
  void took(double seconds);

 private:
  RunTiming timing_;
  int substeps_;
};

/// Model of the present state at rest, for the start of a run.
HandleModel startModel(BuiltScene& scene, const RunTiming& timing);

/// Puts haptic loop and device to the start of a run. @returns the wrench that the hand carries at first
Vec6 startHaptics(BuiltScene& scene, HapticLoop& loop);

/// Runs a scene in virtual time on one thread; the same to the bit on every run on one machine. Tick i is at i * dt;
/// the visual step of a tick samples the device first, and its model arrives `latency` visual steps later.
RunOutcome runLockstep(BuiltScene& scene, const RunTiming& timing, const RunSink& sink);

/// Runs a scene in real time, one thread a loop (session/realtime_loops.h), and the caller's thread for the sink. Stops
/// after the duration.
RunOutcome runRealtime(BuiltScene& scene, const RunTiming& timing, const RunSink& sink);

}  // namespace palpate
