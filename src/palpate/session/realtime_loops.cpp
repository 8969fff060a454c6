#include "palpate/session/realtime_loops.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate {
namespace {

SubstepBudget budgetOf(const RunTiming& timing) { return {timing.visual_step, timing.substeps, timing.substeps_auto}; }

constexpr int kHapticPriority = 80;
constexpr std::size_t kTickRows = 16384;  // at 4 kHz four seconds for the owner to fall behind
constexpr std::size_t kVisualRows = 512;
constexpr std::int64_t kReportEvery = 512;  // ticks

}  // namespace

RealtimeLoops::RealtimeLoops(BuiltScene& scene, const RunTiming& timing, Stepped stepped)
    : scene_(scene),
      timing_(timing),
      stepped_(std::move(stepped)),
      loop_(scene.haptic),
      filter_(scene.haptic.filter),
      last_(startModel(scene, timing)),
      budget_(budgetOf(timing)),
      live_(scene.live, timing.haptic_step),
      points_(kTickRows),
      ticks_(kTickRows),
      visuals_(kVisualRows) {
  filter_.reset(scene.start);
  models_.write(last_);
  startHaptics(scene, loop_);
  points_.push(loop_.path()[loop_.path().end() - 1]);
  if (live()) {
    beginLive();
  } else {
    ++traffic_.made;
  }
}

// A live model of the world as it stands, for the end of the path.
void RealtimeLoops::beginLive() {
  readPath();
  live_.begin(scene_.world, timing_.visual_step, path_.end() - 1, time());
  sendLive();
}

void RealtimeLoops::readPath() {
  PathPoint point;
  while (points_.pop(point)) path_.add(point);
}

// Replayed as far as the path is known; the haptic loop does the rest.
void RealtimeLoops::sendLive() {
  readPath();
  LiveUpdate update{live_.model(), {}};
  replay_.replayAll(path_.end() - 1, update.model, timing_.haptic_step, scene_.world.gravity, path_, update.state);
  if (lives_.write(update)) ++traffic_.overwritten;
  ++traffic_.made;
}

RealtimeLoops::~RealtimeLoops() {
  try {
    stop(Ending::leaves);
  } catch (...) {  // nobody is left to hear of it
  }
}

TickRecord RealtimeLoops::tickAt(std::int64_t k, const DeviceState& device, const HandleModel* model, bool recorded) {
  const double t = static_cast<double>(k) * timing_.haptic_step;
  if (live()) {
    if (const LiveUpdate* update = lives_.read()) loop_.offer(*update);
  }
  const TickRecord record = loop_.tick(device, model, t);
  scene_.device->apply(record.sent, t, timing_.haptic_step);
  last_sent_ = record.sent;
  points_.push(loop_.path()[loop_.path().end() - 1]);
  if (recorded) ticks_.push(record);
  return record;
}

void RealtimeLoops::stepAt(double now, double lateness, const DeviceState& device) {
  substeps_.store(budget_.substeps(), std::memory_order_relaxed);
  VisualStepSettings settings = visualSettings(scene_, timing_);
  settings.substeps = budget_.substeps();
  readPath();
  const DeviceTarget target = aimAt(filter_.accept(device), timing_);
  VisualRecord record = live() ? live_.step(scene_.world, path_, target, settings, now, last_)
                               : visualStep(scene_.world, target, settings, now, last_);
  budget_.took(record.step.times.total() + record.linearization_s);
  last_ = record.model;
  record.lateness_s = lateness;
  const bool unread = models_.write(record.model);
  if (live()) {
    sendLive();
  } else {
    ++traffic_.made;
    if (unread) ++traffic_.overwritten;
  }
  if (stepped_) stepped_(scene_.world, record);
  visuals_.push(record);
}

void RealtimeLoops::runHaptic(double speed, std::int64_t last) {
  const AwakeCores awake;
  grant_ = requestRealtime(kHapticPriority);
  asked_.store(true, std::memory_order_release);
  PeriodicClock clock(timing_.haptic_step / speed);
  const std::int64_t first = tick_;
  clock.start(start_, last - first);
  bool driven = scene_.device->keepsTime();  // by the device
  const auto once = [&] {
    if (stop_.load(std::memory_order_relaxed) == Stop::now) return false;
    const std::int64_t k = first + (driven ? clock.follow(haptic_report_) : clock.wait(haptic_report_));
    if (k < first) {  // the device calls a little too often
      const double t = static_cast<double>(tick_) * timing_.haptic_step;
      scene_.device->sample(t);
      scene_.device->apply(last_sent_, t, timing_.haptic_step);
      return true;
    }
    if (k >= last || stop_.load(std::memory_order_relaxed) == Stop::leave) {
      leaving_.store(true, std::memory_order_relaxed);
      loop_.leave();
    }
    if (loop_.gone()) return false;
    const auto begin = std::chrono::steady_clock::now();
    const DeviceState device = scene_.device->sample(static_cast<double>(k) * timing_.haptic_step);
    samples_.write({device, begin});
    tickAt(k, device, models_.read(), k < last);
    if (k >= last) return true;  // the run is over, the force not gone yet
    tick_ = k + 1;
    haptic_report_.work.add(std::chrono::nanoseconds(std::chrono::steady_clock::now() - begin).count());
    if (++haptic_report_.ticks % kReportEvery == 0) reports_.write(haptic_report_);
    return true;
  };
  if (driven) scene_.device->run(once);
  driven = false;  // one that calls no more is lost: the run goes on without it
  while (once()) {
  }
  haptic_done_.store(true, std::memory_order_release);
}

// A haptic thread of ordinary priority that finds threads at work on every core misses twice as many ticks.
bool RealtimeLoops::leavesRoom(const Executor* executor) const {
  if (executor == nullptr || !asked_.load(std::memory_order_acquire)) return false;
  return grant_.scheduled || executor->threads() < static_cast<int>(std::thread::hardware_concurrency());
}

void RealtimeLoops::runVisual(double speed, double origin, Executor* executor) {
  scene_.world.budget.seconds = stepBudget(timing_.visual_step / speed);
  PeriodicClock clock(timing_.visual_step / speed);
  clock.start(start_);
  const auto goesOn = [this] {
    return stop_.load(std::memory_order_relaxed) == Stop::none && !leaving_.load(std::memory_order_relaxed);
  };
  while (goesOn()) {
    const std::int64_t k = clock.wait(visual_report_);
    if (!goesOn()) break;
    const TimedSample* sample = samples_.read();
    if (sample == nullptr) continue;
    const ExecutorScope scope(leavesRoom(executor) ? executor : nullptr);
    const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    const double lateness = elapsed - static_cast<double>(k) * timing_.visual_step / speed;
    stepAt(origin + elapsed * speed, lateness, sample->device);
    response_.add(std::chrono::nanoseconds(std::chrono::steady_clock::now() - sample->taken).count());
  }
  visual_done_.store(true, std::memory_order_release);
}

void RealtimeLoops::start(double speed, double until) {
  if (started()) return;
  const auto last = static_cast<std::int64_t>(std::llround(std::min(until / timing_.haptic_step, 9e15)));
  stop_.store(Stop::none);
  leaving_.store(false);
  loop_.comeBack();
  asked_.store(false);
  haptic_done_.store(false);
  visual_done_.store(false);
  failure_ = nullptr;
  start_ = std::chrono::steady_clock::now() + kStartDelay;
  visual_ = std::thread([this, speed, origin = time(), executor = Executor::current()] {
    try {
      runVisual(speed, origin, executor);
    } catch (...) {  // the haptic loop must end too
      failure_ = std::current_exception();
      ask(Stop::leave);
      visual_done_.store(true, std::memory_order_release);
    }
  });
  haptic_ = std::thread([this, speed, last] { runHaptic(speed, last); });
}

// None takes back a stronger one.
void RealtimeLoops::ask(Stop stop) noexcept {
  Stop now = stop_.load();
  while (now < stop && !stop_.compare_exchange_weak(now, stop)) {
  }
}

void RealtimeLoops::stop(Ending ending) {
  ask(ending == Ending::leaves || scene_.device->isReal() ? Stop::leave : Stop::now);
  if (haptic_.joinable()) haptic_.join();
  if (visual_.joinable()) visual_.join();
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

bool RealtimeLoops::ended() const {
  return haptic_done_.load(std::memory_order_acquire) && visual_done_.load(std::memory_order_acquire);
}

void RealtimeLoops::stepOnce() {
  if ((started() && !ended()) || scene_.device->isReal()) return;  // no hand can be stopped between two steps
  loop_.comeBack();
  const auto ticks = static_cast<std::int64_t>(std::llround(timing_.visual_step / timing_.haptic_step));
  for (std::int64_t i = 0; i < ticks; ++i, ++tick_) {
    const DeviceState device = scene_.device->sample(time());
    if (i == 0) stepAt(time(), 0.0, device);
    tickAt(tick_, device, models_.read());
  }
}

void RealtimeLoops::change(Rendering rendering, const RunTiming& timing) {
  timing_ = timing;
  budget_ = budgetOf(timing);
  const bool was_live = live();
  loop_.change(rendering, modelAgeLimit(timing.visual_step, timing.latency + timing.jitter));
  if (live() && !was_live) beginLive();
}

const PeriodicReport& RealtimeLoops::report() noexcept {
  if (!started()) return haptic_report_;
  if (const PeriodicReport* newest = reports_.read()) copy_ = *newest;
  return copy_;
}

RunOutcome RealtimeLoops::outcome() const {
  const auto spread = [](const DurationHistogram& h) {
    return std::vector<double>{h.percentile(0.5), h.percentile(0.99), h.max(), h.percentile(0.999)};
  };
  RunOutcome out;
  out.realtime = true;
  out.counters = loop_.counters();
  out.delivered_energy = loop_.passivity().delivered();
  out.switches = loop_.switches();
  out.ticks = haptic_report_.ticks;
  out.end_time = time();
  out.missed = haptic_report_.missed;
  out.most_missed = haptic_report_.most_missed;
  out.dropped_rows = dropped();
  out.tick_us = spread(haptic_report_.work);
  out.wake_us = spread(haptic_report_.wake_latency);
  out.models = traffic_;
  out.models.account = loop_.models();
  out.response_us = spread(response_);
  out.realtime_note = grant_.reason;
  return out;
}

}  // namespace palpate
