#pragma once

#include <cstdint>
#include <deque>
#include <memory>

#include "palpate/devices/device_memory.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/haptics/realtime.h"
#include "palpate/session/run_record.h"
#include "palpate/session/run_timing.h"
#include "palpate/simulation/world_state.h"
#include "palpate/visual/live_step.h"

namespace palpate {

/// A model on its way from the visual loop to the haptic one.
struct ModelArrival {
  std::int64_t tick;  ///< from which on it counts
  HandleModel model;
  std::shared_ptr<const LiveModel> live;  ///< with method `live`
};

/// All of a run in virtual time between two ticks: given back to a run of the same scene, it goes on to the bit.
struct LockstepState {
  std::int64_t tick = 0;  ///< next one
  WorldState world;
  HapticLoopState haptic;
  DeviceFilterState filter;  ///< of the visual loop's samples
  DeviceMemory device;
  HandleModel newest;  ///< in use by the haptic loop
  HandleModel last;    ///< of the last visual step
  LiveVisualState live;
  std::deque<ModelArrival> arrivals;
};

/// A scene that runs in virtual time on one thread; the same to the bit on every run on one machine. Tick i is at
/// i * dt; the visual step of a tick samples the device first, and its model arrives `latency` visual steps later, or
/// up to `jitter` more.
class LockstepRun {
 public:
  /// @param scene, sink  must outlive this
  /// @throws RunError if the first visual step fails
  LockstepRun(BuiltScene& scene, const RunTiming& timing, const RunSink& sink);
  /// Runs all ticks up to `end`, without it, or until the sink says that it is to stop.
  void runUntil(std::int64_t end);
  /// How many ticks the run's duration has.
  std::int64_t ticks() const { return ticks_; }
  /// The next one.
  std::int64_t tick() const { return tick_; }

  LockstepState state() const;
  /// @throws InputError if the state is not of this scene
  void restore(const LockstepState& state);
  RunOutcome outcome() const;

 private:
  void visualStepAt(double t, const DeviceState& device);
  void arrive(const ModelArrival& arrival);
  void tickAt(double t, const DeviceState& device);

  BuiltScene& scene_;
  RunTiming timing_;
  const RunSink& sink_;
  std::int64_t ticks_, ticks_per_step_;
  bool stopped_ = false;
  HapticLoop loop_;
  DeviceFilter filter_;
  std::int64_t tick_ = 0;
  HandleModel newest_, last_;
  LiveVisual live_;
  LiveTick replay_;
  std::deque<ModelArrival> arrivals_;
  DurationHistogram work_;
};

/// Runs a scene in virtual time from start to end.
RunOutcome runLockstep(BuiltScene& scene, const RunTiming& timing, const RunSink& sink);

}  // namespace palpate
