#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <thread>

#include "palpate/haptics/device_filter.h"
#include "palpate/haptics/exchange.h"
#include "palpate/haptics/realtime.h"
#include "palpate/haptics/record_queue.h"
#include "palpate/session/lockstep.h"

namespace palpate {
namespace {

constexpr int kHapticPriority = 80;
constexpr std::chrono::milliseconds kStartDelay{20};  // both threads are up by then, and count from one instant
constexpr std::size_t kTickRows = 4096;               // four seconds for the recording to fall behind
constexpr std::size_t kVisualRows = 512;

/// What the two loops and the recording share. Each exchange has one writer and one reader.
struct Shared {
  LatestValue<HandleModel> models;   // visual to haptic
  LatestValue<DeviceState> samples;  // haptic to visual
  RecordQueue<TickRecord> ticks{kTickRows};
  RecordQueue<VisualRecord> visuals{kVisualRows};
  std::atomic<bool> stop{false};
  std::atomic<bool> haptic_done{false}, visual_done{false};
  std::chrono::steady_clock::time_point start;
};

void hapticThread(BuiltScene& scene, const RunTiming& timing, HapticLoop& loop, Shared& shared, PeriodicReport& report,
                  RealtimeGrant& grant) {
  grant = requestRealtime(kHapticPriority);
  PeriodicClock clock(timing.haptic_step);
  clock.start(shared.start);
  const auto last = static_cast<std::int64_t>(std::llround(timing.duration / timing.haptic_step));
  while (!shared.stop.load(std::memory_order_relaxed)) {
    const std::int64_t k = clock.wait(report);
    if (k >= last) break;
    const auto begin = std::chrono::steady_clock::now();
    const double t = clock.time(k);
    const DeviceState device = scene.device->sample(t);
    shared.samples.write(device);
    const TickRecord record = loop.tick(device, shared.models.read(), t);
    scene.device->apply(record.sent, t, timing.haptic_step);
    shared.ticks.push(record);
    report.work.add(std::chrono::nanoseconds(std::chrono::steady_clock::now() - begin).count());
    ++report.ticks;
  }
  shared.haptic_done.store(true, std::memory_order_release);
}

void visualThread(BuiltScene& scene, const RunTiming& timing, HandleModel last, Shared& shared) {
  DeviceFilter filter(scene.haptic.filter);
  filter.reset(scene.start);
  PeriodicReport report;
  SubstepBudget budget(timing);
  PeriodicClock clock(timing.visual_step);
  clock.start(shared.start);
  while (!shared.stop.load(std::memory_order_relaxed) && !shared.haptic_done.load(std::memory_order_acquire)) {
    const std::int64_t k = clock.wait(report);
    const double now = std::chrono::duration<double>(std::chrono::steady_clock::now() - shared.start).count();
    const DeviceState* device = shared.samples.read();
    if (device == nullptr) continue;
    VisualRecord record = visualStep(scene.world, aimAt(filter.accept(*device), timing), scene.linearization,
                                     timing.visual_step, now, last, budget.substeps());
    budget.took(record.step.times.total() + record.linearization_s);
    last = record.model;
    record.lateness_s = now - clock.time(k);
    shared.models.write(record.model);
    shared.visuals.push(record);
  }
  shared.visual_done.store(true, std::memory_order_release);
}

}  // namespace

RunOutcome runRealtime(BuiltScene& scene, const RunTiming& timing, const RunSink& sink) {
  Shared shared;
  HapticLoop loop(scene.haptic);
  const HandleModel first = startModel(scene, timing);
  shared.models.write(first);
  startHaptics(scene, loop);
  PeriodicReport report;
  RealtimeGrant grant;
  shared.start = std::chrono::steady_clock::now() + kStartDelay;
  std::exception_ptr failure;
  std::thread haptic([&] { hapticThread(scene, timing, loop, shared, report, grant); });
  std::thread visual([&] {
    try {
      visualThread(scene, timing, first, shared);
    } catch (...) {  // the haptic loop must end too; its watchdog lets the force fade first
      failure = std::current_exception();
      shared.stop.store(true);
      shared.visual_done.store(true, std::memory_order_release);
    }
  });
  TickRecord tick;
  VisualRecord step;
  for (bool last = false;;) {
    while (shared.visuals.pop(step)) sink.visual(step);
    while (shared.ticks.pop(tick)) {
      sink.tick(tick);
      sink.progress(tick.time / timing.duration);
    }
    if (last) break;
    last = shared.haptic_done.load(std::memory_order_acquire) && shared.visual_done.load(std::memory_order_acquire);
    if (!last) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  haptic.join();
  visual.join();
  if (failure) std::rethrow_exception(failure);
  sink.progress(1.0);
  RunOutcome out;
  out.realtime = true;
  out.counters = loop.counters();
  out.delivered_energy = loop.passivity().delivered();
  out.ticks = report.ticks;
  out.missed = report.missed;
  out.dropped_rows = shared.ticks.dropped() + shared.visuals.dropped();
  out.tick_us = {report.work.percentile(0.5), report.work.percentile(0.99), report.work.max()};
  out.wake_us = {report.wake_latency.percentile(0.5), report.wake_latency.percentile(0.99), report.wake_latency.max()};
  out.realtime_note = grant.reason;
  return out;
}

}  // namespace palpate
