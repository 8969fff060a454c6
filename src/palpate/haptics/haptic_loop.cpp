#include "palpate/haptics/haptic_loop.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/common/error.h"

namespace palpate {
namespace {

void validate(const HapticSettings& settings) {
  const auto require = [](bool good, const char* key, const char* cause) {
    if (!good) throw InputError("haptics", key, cause);
  };
  const auto notNegative = [](double value) { return value >= 0.0 && std::isfinite(value); };
  require(settings.dt > 0.0 && std::isfinite(settings.dt), "dt", "must be positive");
  require(notNegative(settings.link.stiffness), "link.stiffness", "must not be negative");
  require(notNegative(settings.link.damping), "link.damping", "must not be negative");
  require(notNegative(settings.link.rotational_stiffness), "link.rotational_stiffness", "must not be negative");
  require(notNegative(settings.link.rotational_damping), "link.rotational_damping", "must not be negative");
  require(settings.link.peak_force > 0, "link.peak_force", "must be positive");
  require(settings.link.peak_torque > 0, "link.peak_torque", "must be positive");
  require(settings.compensation.weight.allFinite(), "compensation.weight", "must be finite");
  require(settings.compensation.center.allFinite(), "compensation.center", "must be finite");
}

}  // namespace

bool isFinite(const HandleModel& model) noexcept {
  return model.force.allFinite() && model.pose.allFinite() && model.twist.allFinite() && model.kx.allFinite() &&
         model.kv.allFinite() && model.handle_pose.allFinite() && model.handle_twist.allFinite() &&
         std::isfinite(model.time);
}

HapticLoop::HapticLoop(const HapticSettings& settings)
    : settings_(settings), filter_(settings.filter), proxy_(settings.proxy), safety_(settings.safety) {
  validate(settings);
}

Vec6 HapticLoop::start(const Pose& device_pose, const Pose& proxy_pose, double now) noexcept {
  filter_.reset(device_pose);
  proxy_.reset(proxy_pose, Vec6::Zero());
  observer_.reset();
  counters_ = {};
  has_model_ = has_live_ = has_pending_ = false;
  offered_ = HapticLoopState::kNoOffer;
  account_ = {};
  models_ = {};
  path_.clear();
  path_.add({0, proxy_pose, Vec6::Zero()});
  start_time_ = last_time_ = now;
  last_device_pose_ = device_pose;
  const DeviceState device{device_pose, Vec6::Zero(), 0};
  const Vec6 raw = couplingWrench(settings_.link, proxy_pose, Vec6::Zero(), device);
  last_sent_ = safety_.start(compensate(raw, proxy_pose), device_pose.position);
  return last_sent_;
}

TickRecord HapticLoop::tick(const DeviceState& sample, const HandleModel* newest, double now) noexcept {
  TickRecord record;
  record.time = now;
  const double since_last = now - last_time_;
  Vec6 displacement;
  record.device = readDevice(sample, since_last, displacement, record.flags);
  const HandleModel* model = takeModel(newest, record.flags);
  record.model_age = model ? now - model->time : std::numeric_limits<double>::infinity();
  record.raw = render(model, record.device, record);
  path_.add({path_.end(), proxy_.pose(), proxy_.twist()});

  const double since_start = now - start_time_;
  const auto safe = safety_.process(
      {model ? compensate(record.raw, record.proxy) : record.raw, since_start, model ? record.model_age : since_start,
       settings_.dt, record.device.twist, since_last, displacement, record.device.pose.position, record.device.buttons,
       !record.flags.has(TickFlag::device_rejected), record.device.force_limit, record.device.torque_limit},
      observer_);
  last_time_ = now;
  record.sent = last_sent_ = safe.wrench;
  record.flags |= safe.flags;
  record.delivered_energy = observer_.delivered();
  counters_.add(record.flags);
  return record;
}

HapticLoopState HapticLoop::state() const noexcept {
  return {filter_.state(), proxy_.state(),      safety_.state(), observer_,    counters_, model_,   has_model_,
          live_[current_], live_[1 - current_], has_live_,       has_pending_, offered_,  account_, path_,
          start_time_,     last_device_pose_,   last_sent_,      last_time_,   models_};
}

void HapticLoop::restore(const HapticLoopState& state) noexcept {
  filter_.restore(state.filter);
  proxy_.restore(state.proxy);
  safety_.restore(state.safety);
  observer_ = state.passivity;
  counters_ = state.counters;
  model_ = state.model;
  has_model_ = state.has_model;
  live_[current_] = state.live;
  live_[1 - current_] = state.pending;
  has_live_ = state.has_live;
  has_pending_ = state.has_pending;
  offered_ = state.offered;
  account_ = state.account;
  path_ = state.path;
  start_time_ = state.start_time;
  last_device_pose_ = state.device_pose;
  last_sent_ = state.sent;
  last_time_ = state.last_time;
  models_ = state.models;
}

void HapticLoop::change(Rendering rendering, double model_age_limit) noexcept {
  settings_.rendering = rendering;
  if (rendering != Rendering::live) {
    has_live_ = has_pending_ = false;
    offered_ = HapticLoopState::kNoOffer;
  }
  settings_.safety.model_age_limit = model_age_limit;
  safety_.setModelAgeLimit(model_age_limit);
}

DeviceState HapticLoop::readDevice(const DeviceState& sample, double since_last, Vec6& displacement,
                                   TickFlags& flags) noexcept {
  const std::uint64_t rejected = filter_.rejected();
  // A device that has jumped and stays there is believed once the force has left.
  const double elapsed =
      safety_.absent() ? std::numeric_limits<double>::infinity() : std::max(since_last, settings_.dt);
  const DeviceState& device = filter_.accept(sample, elapsed);
  if (filter_.rejected() != rejected) flags.set(TickFlag::device_rejected);
  displacement = poseDifference(device.pose, last_device_pose_);
  observer_.add(last_sent_, displacement);
  last_device_pose_ = device.pose;
  return device;
}

const HandleModel* HapticLoop::takeModel(const HandleModel* newest, TickFlags& flags) noexcept {
  const bool is_new = newest && (!has_model_ || newest->time != model_.time);
  const bool counts = is_new && settings_.rendering != Rendering::live;  // those are counted where they are replayed
  if (newest && isFinite(*newest)) {
    model_ = *newest;
    has_model_ = true;
    if (counts) ++models_.given, ++models_.used;
  } else if (newest) {
    flags.set(TickFlag::model_rejected);
    if (counts) ++models_.given, ++models_.refused;
  }
  if (has_model_ && model_.unsound) flags.set(TickFlag::model_unsound);
  if (has_model_) return &model_;
  flags.set(TickFlag::model_missing);
  return nullptr;
}

void HapticLoop::offer(const LiveUpdate& update) noexcept {
  if (update.model.index <= offered_) return;
  offered_ = update.model.index;
  ++models_.given;
  if (has_pending_) ++models_.overtaken;
  live_[1 - current_] = update;
  has_pending_ = true;
}

// A new model is used from the tick on in which it has caught up with the path.
void HapticLoop::takeLive(TickFlags& flags) noexcept {
  if (!has_pending_) return;
  constexpr int kMost = 4;  // ticks replayed within one
  const std::int64_t now = path_.end() - 1;
  LiveUpdate& pending = live_[1 - current_];
  const bool known =
      live_tick_.replayTo(now, kMost, pending.model, settings_.dt, settings_.proxy.gravity, path_, pending.state);
  if (!known || !isFinite(pending.state) || !isFinite(pending.model)) {
    has_pending_ = false;
    ++models_.refused;
    flags.set(TickFlag::model_rejected);
  } else if (pending.state.index < now) {
    flags.set(TickFlag::model_catching_up);
  } else {
    has_pending_ = false;
    ++(changeLive(flags) ? models_.used : models_.refused);
  }
}

bool HapticLoop::changeLive(TickFlags& flags) noexcept {
  LiveUpdate& next = live_[1 - current_];
  if (has_live_) {
    const LiveUpdate& used = live_[current_];
    const Pose& pose = proxy_.pose();
    const Vec6& twist = proxy_.twist();
    const Vec3& gravity = settings_.proxy.gravity;
    const double before = liveEnergy(used.model, used.state, pose, twist, gravity);
    const auto verdict = account_.change(before, next.model, pose, twist, gravity, next.state);
    if (verdict == SwitchAccount::Verdict::damped) flags.set(TickFlag::model_damped);
    if (verdict == SwitchAccount::Verdict::refused) {
      flags.set(TickFlag::model_rejected);
      return false;
    }
  }
  current_ = 1 - current_;
  has_live_ = true;
  return true;
}

TickFlags HapticLoop::stepLive(const DeviceState& device) noexcept {
  const double dt = settings_.dt;
  if (!has_live_) return proxy_.step(nullptr, settings_.link, device, dt);
  LiveUpdate& live = live_[current_];
  const LinkParameters link = saturated(settings_.link, proxy_.pose(), proxy_.twist(), device.pose, device.twist);
  const LiveTickInput input{dt, settings_.proxy.gravity, link, device.pose, device.twist};
  const Vec6 twist = live_tick_.step(live.model, input, proxy_.pose(), proxy_.twist(), live.state);
  const Vec6 slip = device.twist - twist;
  account_.earn(dt *
                (link.damping * slip.head<3>().squaredNorm() + link.rotational_damping * slip.tail<3>().squaredNorm() +
                 ((live.model.damping.array() - live.model.alpha).max(0.0) * live.state.speed.array().square()).sum()));
  const TickFlags flags = proxy_.move(twist, device, dt);
  if (!isFinite(live.state)) has_live_ = false;  // the next model begins anew
  return flags;
}

Vec6 HapticLoop::render(const HandleModel* model, const DeviceState& device, TickRecord& record) noexcept {
  if (settings_.rendering == Rendering::linearized) {
    record.flags |= proxy_.step(model, settings_.link, device, settings_.dt);
  } else if (settings_.rendering == Rendering::live) {
    takeLive(record.flags);
    record.flags |= stepLive(device);
  } else if (model) {
    proxy_.reset(model->handle_pose, model->handle_twist);
  } else {
    record.proxy = proxy_.pose();
    return Vec6::Zero();
  }
  record.proxy = proxy_.pose();
  record.proxy_twist = proxy_.twist();
  return couplingWrench(settings_.link, record.proxy, record.proxy_twist, device);
}

Vec6 HapticLoop::compensate(const Vec6& wrench, const Pose& handle) const noexcept {
  const CompensatedWeight& tool = settings_.compensation;
  Vec6 result = wrench;
  result.head<3>() -= tool.weight;
  result.tail<3>() -= (handle.rotation * tool.center).cross(tool.weight);
  return result;
}

}  // namespace palpate
