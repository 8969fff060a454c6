#include "palpate/haptics.h"

#include <cmath>
#include <string_view>

#include "palpate/devices/driver_list.h"
#include "palpate/devices/hardware_device.h"
#include "palpate/devices/prescribed_device.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/exchange.h"
#include "palpate/haptics/realtime.h"
#include "palpate/library/convert.h"
#include "palpate/math/rotation.h"

namespace palpate::v0 {

using library::from;
using library::guarded;
using library::to;

const char* version() noexcept { return PALPATE_VERSION_STRING; }

// --- errors

// The rooms' keys say the line as well.
InputError::InputError(std::string file, std::string key, std::string cause)
    : std::runtime_error(file + (key.empty() ? "" : ": " + key) + ": " + cause),
      file_(std::move(file)),
      key_(key.substr(0, key.find(" (line "))),
      cause_(std::move(cause)) {}
InputError::~InputError() = default;
RunError::RunError(const std::string& what) : std::runtime_error(what) {}
RunError::~RunError() = default;

// --- handle, model, device

Vector6 difference(const Pose& pose, const Pose& origin) noexcept {
  return to(poseDifference(from(pose), from(origin)));
}

Pose moved(const Pose& pose, const Vector6& change) noexcept { return to(advance(from(pose), from(change))); }

Vector6 HandleModel::at(const Pose& x, const Vector6& u) const noexcept {
  const Vec6 dx = poseDifference(from(x), from(pose)), du = from(u) - from(twist);
  return to(Vec6(from(force) + from(kx) * dx + from(kv) * du));
}

Link Link::of(const DeviceLimits& limits) noexcept { return to(linkForDevice(from(limits))); }

Vector6 Link::wrenchOnDevice(const Pose& handle, const Vector6& twist, const DeviceState& device) const noexcept {
  return to(couplingWrench(from(*this), from(handle), from(twist), from(device)));
}

Device::Device() = default;
Device::~Device() = default;
DeviceLimits Device::limits() const noexcept { return {}; }
void Device::begin(const Pose& /*start*/, const Vector6& /*wrench*/) noexcept {}
bool Device::keepsTime() const noexcept { return false; }
void Device::run(const std::function<bool()>& /*tick*/) {}
bool Device::isReal() const noexcept { return false; }
const char* Device::failure() const noexcept { return nullptr; }
std::vector<double> Device::save() const { return {}; }
void Device::restore(const std::vector<double>& memory) {
  if (!memory.empty()) throw InputError("memory of the device", name(), "must be empty");
}

namespace {

/// A device of the rooms for the user.
class OwnDevice final : public Device {
 public:
  explicit OwnDevice(std::unique_ptr<palpate::Device> device) : device_(std::move(device)) {}
  const char* name() const noexcept override { return device_->name(); }
  DeviceLimits limits() const noexcept override { return to(device_->limits()); }
  void begin(const Pose& /*start*/, const Vector6& wrench) noexcept override { device_->begin(from(wrench)); }
  DeviceState sample(double t) noexcept override { return to(device_->sample(t)); }
  void apply(const Vector6& wrench, double t, double dt) noexcept override { device_->apply(from(wrench), t, dt); }
  bool keepsTime() const noexcept override { return device_->keepsTime(); }
  void run(const std::function<bool()>& tick) override { device_->run(tick); }
  bool isReal() const noexcept override { return device_->isReal(); }
  const char* failure() const noexcept override { return device_->failure(); }
  std::vector<double> save() const override { return device_->save(); }
  void restore(const std::vector<double>& memory) override {
    guarded([&] { device_->restore(memory); });
  }

 private:
  std::unique_ptr<palpate::Device> device_;
};

template <class Kind, class... Arguments>
std::unique_ptr<Device> makeDevice(Arguments&&... arguments) {
  return std::make_unique<OwnDevice>(std::make_unique<Kind>(std::forward<Arguments>(arguments)...));
}

}  // namespace

std::unique_ptr<Device> simulatedDevice(const Path& path, const Pose& start, const SimulatedHand& hand,
                                        const DeviceLimits& limits) {
  const SimulatedDeviceSettings settings{hand.mass,
                                         hand.damping,
                                         hand.inertia,
                                         hand.rotational_damping,
                                         hand.stiffness,
                                         hand.hand_damping,
                                         hand.rotational_stiffness,
                                         hand.hand_rotational_damping,
                                         from(limits)};
  return guarded([&] { return makeDevice<palpate::SimulatedDevice>(settings, from(path), from(start)); });
}

std::unique_ptr<Device> prescribedDevice(const Path& path, const Pose& start, const DeviceLimits& limits) {
  return guarded([&] { return makeDevice<palpate::PrescribedDevice>(from(path), from(start), from(limits)); });
}

std::vector<std::pair<std::string, std::string>> deviceKinds() {
  std::vector<std::pair<std::string, std::string>> out;
  for (const DriverKind& kind : driverKinds()) out.emplace_back(kind.name, kind.what);
  return out;
}

namespace {

/// On a desk, with the limits that it has at this tick.
class DeskDevice final : public palpate::Device {
 public:
  DeskDevice(const std::shared_ptr<DeviceDriver>& driver, const WorkspaceSettings& settings, const palpate::Pose& start,
             double step)
      : device_(driver, settings, start), limits_(worldLimits(driver->info(), settings, step)) {}
  const char* name() const noexcept override { return device_.name(); }
  palpate::DeviceLimits limits() const noexcept override { return limits_; }
  palpate::DeviceState sample(double t) noexcept override { return device_.sample(t); }
  void apply(const Vec6& wrench, double t, double dt) noexcept override { device_.apply(wrench, t, dt); }
  bool keepsTime() const noexcept override { return device_.keepsTime(); }
  void run(const std::function<bool()>& tick) override { device_.run(tick); }
  bool isReal() const noexcept override { return true; }
  const char* failure() const noexcept override { return device_.failure(); }

 private:
  HardwareDevice device_;
  palpate::DeviceLimits limits_;
};

void requireKnown(const DriverKind& kind, const DeviceOptions& options) {
  const auto isIn = [](const std::vector<DeviceOption>& known, const std::string& key) {
    return std::any_of(known.begin(), known.end(), [&](const DeviceOption& o) { return key == o.key; });
  };
  for (const auto& [key, value] : options.values()) {
    if (!isIn(kind.options, key) && !isIn(workspaceOptions(), key)) {
      throw palpate::InputError(kind.name, key, "unknown option");
    }
  }
}

}  // namespace

std::unique_ptr<Device> openDevice(const std::string& kind, const std::string& options, const Pose& start,
                                   double step) {
  return guarded([&]() -> std::unique_ptr<Device> {
    for (const DriverKind& k : driverKinds()) {
      if (kind != k.name) continue;
      const DeviceOptions parsed = DeviceOptions::parse(options);
      requireKnown(k, parsed);
      return makeDevice<DeskDevice>(k.open(parsed, OpenFor::running), workspaceSettings(parsed), from(start), step);
    }
    throw palpate::InputError("device", kind, "there is no driver of this name");
  });
}

// --- safety

Safety Safety::of(const DeviceLimits& limits) noexcept { return to(safetyForDevice(SafetySettings{}, from(limits))); }

// The same flags in the same order.
#define PALPATE_SAME_FLAG(name) static_assert(int(TickFlag::name) == int(palpate::TickFlag::name))
PALPATE_SAME_FLAG(device_rejected);
PALPATE_SAME_FLAG(model_rejected);
PALPATE_SAME_FLAG(model_missing);
PALPATE_SAME_FLAG(model_rotation_clamped);
PALPATE_SAME_FLAG(stiffness_projected);
PALPATE_SAME_FLAG(proxy_limited);
PALPATE_SAME_FLAG(proxy_reset);
PALPATE_SAME_FLAG(wrench_non_finite);
PALPATE_SAME_FLAG(model_stale);
PALPATE_SAME_FLAG(force_clamped);
PALPATE_SAME_FLAG(torque_clamped);
PALPATE_SAME_FLAG(slew_limited);
PALPATE_SAME_FLAG(ramping);
PALPATE_SAME_FLAG(passivity_damped);
PALPATE_SAME_FLAG(model_catching_up);
PALPATE_SAME_FLAG(model_damped);
PALPATE_SAME_FLAG(model_unsound);
PALPATE_SAME_FLAG(gap);
PALPATE_SAME_FLAG(fading);
PALPATE_SAME_FLAG(device_lost);
PALPATE_SAME_FLAG(button_released);
PALPATE_SAME_FLAG(outside_workspace);
PALPATE_SAME_FLAG(gate_closed);
PALPATE_SAME_FLAG(oscillation);
PALPATE_SAME_FLAG(calmed);
PALPATE_SAME_FLAG(device_limited);
PALPATE_SAME_FLAG(count);
#undef PALPATE_SAME_FLAG

const char* toString(TickFlag flag) noexcept {
  return flag < TickFlag::count ? palpate::toString(static_cast<palpate::TickFlag>(flag)) : "";
}

struct SafetyChain::Impl {
  explicit Impl(const SafetySettings& settings) : chain(settings) {}
  palpate::SafetyChain chain;
  PassivityObserver observer;
  palpate::Pose pose;        // of the device, at the last call
  Vec6 sent = Vec6::Zero();  // by it
  double now = 0.0;          // of it [s]
};

SafetyChain::SafetyChain(const Safety& settings)
    : impl_(guarded([&] { return std::make_unique<Impl>(from(settings)); })) {}
SafetyChain::~SafetyChain() = default;
SafetyChain::SafetyChain(SafetyChain&&) noexcept = default;
SafetyChain& SafetyChain::operator=(SafetyChain&&) noexcept = default;

Vector6 SafetyChain::start(const Vector6& wrench, const DeviceState& device) noexcept {
  impl_->observer.reset();
  impl_->pose = from(device.pose);
  impl_->now = 0.0;
  impl_->sent = impl_->chain.start(from(wrench), impl_->pose.position);
  return to(impl_->sent);
}

SafetyChain::Output SafetyChain::process(const Vector6& wrench, const DeviceState& device, double model_age,
                                         double now) noexcept {
  Impl& m = *impl_;
  const palpate::Pose pose = from(device.pose);
  const double elapsed = now - m.now;
  palpate::SafetyChain::Input input;
  input.wrench = from(wrench);
  input.since_start = now;
  input.model_age = model_age;
  input.dt = elapsed;
  input.device_twist = from(device.twist);
  input.since_last = elapsed;
  input.displacement = poseDifference(pose, m.pose);
  input.position = pose.position;
  input.buttons = device.buttons;
  input.force_limit = device.force_limit;
  input.torque_limit = device.torque_limit;
  m.observer.add(m.sent, input.displacement);
  const palpate::SafetyChain::Output out = m.chain.process(input, m.observer);
  m.pose = pose;
  m.now = now;
  m.sent = out.wrench;
  return {to(out.wrench), out.flags.bits()};
}

void SafetyChain::leave() noexcept { impl_->chain.leave(); }
bool SafetyChain::gone() const noexcept { return impl_->chain.gone(); }
double SafetyChain::deliveredEnergy() const noexcept { return impl_->observer.delivered(); }

// --- loop

struct HapticState::Impl {
  HapticLoopState state;
};

HapticState::HapticState() = default;
HapticState::HapticState(const HapticState&) = default;
HapticState& HapticState::operator=(const HapticState&) = default;
HapticState::~HapticState() = default;

struct HapticLoop::Impl {
  explicit Impl(const HapticSettings& s) : settings(s), loop(from(s)) {}
  HapticSettings settings;
  palpate::HapticLoop loop;
};

HapticLoop::HapticLoop(const HapticSettings& settings)
    : impl_(guarded([&] { return std::make_unique<Impl>(settings); })) {}
HapticLoop::~HapticLoop() = default;
HapticLoop::HapticLoop(HapticLoop&&) noexcept = default;
HapticLoop& HapticLoop::operator=(HapticLoop&&) noexcept = default;

Vector6 HapticLoop::start(const Pose& device, const Pose& handle, double now) noexcept {
  return to(impl_->loop.start(from(device), from(handle), now));
}

Tick HapticLoop::tick(const DeviceState& device, const HandleModel* newest, double now) noexcept {
  if (newest == nullptr) return to(impl_->loop.tick(from(device), nullptr, now));
  const palpate::HandleModel model = from(*newest);
  return to(impl_->loop.tick(from(device), &model, now));
}

void HapticLoop::leave() noexcept { impl_->loop.leave(); }
bool HapticLoop::gone() const noexcept { return impl_->loop.gone(); }
void HapticLoop::comeBack() noexcept { impl_->loop.comeBack(); }
std::uint64_t HapticLoop::count(TickFlag flag) const noexcept {
  return flag < TickFlag::count ? impl_->loop.counters()[static_cast<palpate::TickFlag>(flag)] : 0;
}

HapticState HapticLoop::state() const {
  HapticState out;
  out.impl_ = std::make_shared<HapticState::Impl>(HapticState::Impl{impl_->loop.state()});
  return out;
}

void HapticLoop::restore(const HapticState& state) {
  if (!state.impl_) throw InputError("state of the haptic loop", "", "there is none");
  impl_->loop.restore(state.impl_->state);
}

const HapticSettings& HapticLoop::settings() const noexcept { return impl_->settings; }

// --- real time

struct ModelExchange::Impl {
  LatestValue<HandleModel> models;
};

ModelExchange::ModelExchange() : impl_(std::make_unique<Impl>()) {}
ModelExchange::~ModelExchange() = default;
void ModelExchange::publish(const HandleModel& model) noexcept { impl_->models.write(model); }
const HandleModel* ModelExchange::newest() noexcept { return impl_->models.read(); }

namespace {

constexpr int kPriority = 80;  // as palpate run

Percentiles percentiles(const DurationHistogram& h) {
  return {h.percentile(0.5), h.percentile(0.99), h.percentile(0.999), h.max()};
}

}  // namespace

LoopReport runHapticLoop(HapticLoop& loop, Device& device, ModelExchange& models, double duration,
                         const std::atomic<bool>& stop, const std::function<void(const Tick&)>& each) {
  const double step = loop.settings().step;
  const RealtimeGrant grant = requestRealtime(kPriority);
  PeriodicReport report;
  guarded([&] {
    PeriodicClock clock(step);
    clock.start();
    const auto tick = [&](std::int64_t k) {
      const auto begin = PeriodicClock::Clock::now();
      const double t = clock.time(k);
      if (t >= duration || stop.load(std::memory_order_relaxed) || device.failure() != nullptr) loop.leave();
      const Tick record = loop.tick(device.sample(t), models.newest(), t);
      device.apply(record.sent, t, step);
      if (each) each(record);
      report.work.add(std::chrono::nanoseconds(PeriodicClock::Clock::now() - begin).count());
      ++report.ticks;
      return !loop.gone();
    };
    if (device.keepsTime()) {
      device.run([&] {
        const std::int64_t k = clock.follow(report);
        return k < 0 || tick(k);
      });
    } else {
      while (tick(clock.wait(report))) {
      }
    }
  });
  if (device.failure() != nullptr) throw RunError(std::string(device.name()) + ": " + device.failure());
  return {report.ticks, report.missed, report.most_missed, percentiles(report.work), percentiles(report.wake_latency),
          grant.reason};
}

}  // namespace palpate::v0
