#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <string>
#include <thread>

#include "palpate/common/parallel.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/haptics/exchange.h"
#include "palpate/haptics/realtime.h"
#include "palpate/haptics/record_queue.h"
#include "palpate/session/run_record.h"
#include "palpate/session/run_timing.h"
#include "palpate/visual/live_step.h"
#include "palpate/visual/substep_budget.h"

// What runs and what crosses. A LatestValue never makes either side wait: the writer overwrites, the reader takes the
// newest. A RecordQueue keeps order; when it is full the row is dropped and counted.
//
//   +--------------------------------+   TimedSample: LatestValue samples_   +---------------------------------+
//   | haptic thread, 1 kHz,          | ------------------------------------> | visual thread, about 30 Hz      |
//   | real-time priority if granted  |                                       | + the owner's Executor's workers|
//   | owns: HapticLoop, Device       | <------------------------------------ | owns: World, DeviceFilter,      |
//   |                                |    HandleModel: LatestValue models_   | SubstepBudget, LiveVisual       |
//   |                                | <------------------------------------ |                                 |
//   |                                |    LiveUpdate: LatestValue lives_     |                                 |
//   |                                | ------------------------------------> |                                 |
//   |                                |    PathPoint: RecordQueue points_     |                                 |
//   +---------------+----------------+                                       +----------------+----------------+
//                   |  TickRecord: RecordQueue ticks_                                         |
//                   |  PeriodicReport: LatestValue reports_                                   |
//                   |  refused priority: grant_, published by asked_    VisualRecord: RecordQueue visuals_
//                   |                                       exception of a step: failure_, read after joining
//                   v                                                                         v
//   +---------------------------------------------------------------------------------------------------------+
//   | owner's thread: start(), stop(), pop(), report(); while both threads are joined also stepOnce(), change()|
//   +---------------------------------------------------------------------------------------------------------+
//                   |  stop_ (atomic), to both;  haptic_done_, visual_done_ (atomic), back
//                   |  leaving_ (atomic): haptic to visual, when time is up

namespace palpate {

/// The two loops of a run in real time, each on a thread of its own, which can be stopped and started again: the run
/// goes on where it stood. All calls but the loops themselves come from one thread, the owner's, whose Executor the
/// visual loop takes over while it runs: unless the haptic loop was refused real-time priority and would have no core
/// left.
class RealtimeLoops {
 public:
  /// From start() to the first tick: both threads are up by then, and count from one instant.
  static constexpr std::chrono::milliseconds kStartDelay{20};

  /// What a visual step may take by the clock before it ends early [s]: what follows it needs the rest.
  /// @param period  from one to the next [s]
  static constexpr double stepBudget(double period) { return 0.8 * period; }

  /// Called on the visual loop's thread after each step.
  using Stepped = std::function<void(const World&, const VisualRecord&)>;

  /// @param scene  must outlive this; while the loops run they alone touch its world and device
  /// @throws RunError if the first visual step fails, InputError for settings out of range
  RealtimeLoops(BuiltScene& scene, const RunTiming& timing, Stepped stepped);
  ~RealtimeLoops();
  RealtimeLoops(const RealtimeLoops&) = delete;
  RealtimeLoops& operator=(const RealtimeLoops&) = delete;

  /// @param speed  of simulated time against the clock, 1 in real time; periods are divided by it
  /// @param until  simulated time at which the loops end by themselves [s]
  void start(double speed, double until);
  /// What becomes of the force when the loops end.
  enum class Ending {
    kept,    ///< what the last tick sent, for a short stop that the run goes on after
    leaves,  ///< ticks go on until the safety stage has faded it out
  };
  /// Asks both loops to end, the force leaving first; ended() says when they have.
  void askToEnd() noexcept { ask(Stop::leave); }
  /// Ends both loops, the haptic one after its tick, the visual one after its step. @throws what a visual step threw
  void stop(Ending ending = Ending::kept);
  bool started() const { return haptic_.joinable(); }
  /// Both loops have ended by themselves: time is up, or a step threw, which stop() tells. The force has left.
  bool ended() const;

  /// While stopped: one visual step and its ticks, in virtual time.
  void stepOnce();
  /// While stopped: another way to make the force, another visual step.
  void change(Rendering rendering, const RunTiming& timing);

  /// Simulated time of the next tick while stopped [s].
  double time() const { return static_cast<double>(tick_) * timing_.haptic_step; }
  const RunTiming& timing() const { return timing_; }
  int substeps() const { return substeps_.load(std::memory_order_relaxed); }
  /// Newest model of the run's handle while stopped.
  const HandleModel& model() const { return last_; }

  // Rows for the owner, in order.
  bool pop(TickRecord& row) noexcept { return ticks_.pop(row); }
  bool pop(VisualRecord& row) noexcept { return visuals_.pop(row); }
  std::uint64_t dropped() const noexcept { return ticks_.dropped() + visuals_.dropped(); }
  /// Timing of the haptic loop so far, renewed twice a second while it runs.
  const PeriodicReport& report() noexcept;
  /// From a device sample to the end of the visual step that it went into, while stopped.
  const DurationHistogram& response() const noexcept { return response_; }
  /// Core that the haptic loop stays on; -1: any.
  int core() const noexcept { return asked_.load(std::memory_order_acquire) ? grant_.core : -1; }
  /// What the system refused to the haptic loop, for people; empty when it refused nothing or has not been asked yet.
  const std::string& realtimeNote() const noexcept {
    return asked_.load(std::memory_order_acquire) ? grant_.reason : none_;
  }
  /// While stopped: what the run as a whole says so far.
  RunOutcome outcome() const;

 private:
  enum class Stop : int { none, leave, now };
  void ask(Stop stop) noexcept;
  void runHaptic(double speed, std::int64_t last);
  void runVisual(double speed, double origin, Executor* executor);
  bool leavesRoom(const Executor* executor) const;
  TickRecord tickAt(std::int64_t k, const DeviceState& device, const HandleModel* model, bool recorded = true);
  struct TimedSample {
    DeviceState device;
    std::chrono::steady_clock::time_point taken;
  };
  void stepAt(double now, double lateness, const DeviceState& device);
  bool live() const { return loop_.settings().rendering == Rendering::live; }
  void beginLive();
  void readPath();
  void sendLive();

  BuiltScene& scene_;
  RunTiming timing_;
  Stepped stepped_;
  HapticLoop loop_;
  DeviceFilter filter_;
  HandleModel last_;
  SubstepBudget budget_;
  LiveVisual live_;
  HandlePath path_;  // as far as the visual loop knows it
  LiveTick replay_;
  PeriodicReport haptic_report_, visual_report_, copy_;
  DurationHistogram response_;
  ModelTraffic traffic_;
  RealtimeGrant grant_;  // the haptic loop's, until asked_
  const std::string none_;
  LatestValue<HandleModel> models_;   // visual to haptic
  LatestValue<LiveUpdate> lives_;     // the same, with method `live`
  LatestValue<TimedSample> samples_;  // haptic to visual
  RecordQueue<PathPoint> points_;     // the same, with method `live`
  LatestValue<PeriodicReport> reports_;
  RecordQueue<TickRecord> ticks_;
  RecordQueue<VisualRecord> visuals_;
  std::int64_t tick_ = 0;  // next one
  Vec6 last_sent_ = Vec6::Zero();
  std::atomic<Stop> stop_{Stop::none};
  std::atomic<bool> leaving_{false};
  std::atomic<bool> asked_{false};
  std::atomic<bool> haptic_done_{true}, visual_done_{true};
  std::atomic<int> substeps_{1};
  std::chrono::steady_clock::time_point start_;
  std::exception_ptr failure_;
  std::thread haptic_, visual_;
};

/// Runs a scene in real time, one thread a loop, and the caller's thread for the sink. Ends after the duration, or when
/// the sink says so or a visual step throws, which the outcome tells; in the end the force leaves.
/// @throws RunError if the first visual step fails
RunOutcome runRealtime(BuiltScene& scene, const RunTiming& timing, const RunSink& sink);

}  // namespace palpate
