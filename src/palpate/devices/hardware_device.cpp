#include "palpate/devices/hardware_device.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "palpate/math/cut_norm.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

constexpr double kLateTime = 0.05;    // without a sample, until the device counts as lost [s]
constexpr double kFadeTime = 0.1;     // in which the limit of the force goes to zero [s]
constexpr double kReturnTime = 0.5;   // and comes back [s]
constexpr double kMaxSpeed = 5.0;     // that is still one [m/s]
constexpr double kMaxStep = 0.005;    // the same where a device is slower than the tick [m]
constexpr double kHandSpeed = 2.0;    // of a hand [m/s]
constexpr double kSlowSpeed = 0.1;    // [m/s]
constexpr double kSteadyTime = 0.02;  // after a jump, until the new place is believed [s]
constexpr double kSpinTime = 0.005;   // of the filter of differences of orientation [s]

Vec6 turned(const Quat& turn, const Vec6& v, double linear) {
  Vec6 out;
  out << linear * (turn * Vec3(v.head<3>())), turn * Vec3(v.tail<3>());
  return out;
}

}  // namespace

const std::vector<DeviceOption>& workspaceOptions() {
  static const std::vector<DeviceOption> options{
      {"motion_scale", "the handle's motion for the device's, 0.01 to 100; 1"},
      {"force_scale", "the device's force for the scene's, 0.01 to 100; 1"},
      {"turn", "of the device about z in the scene, degrees, -360 to 360; 0: y is away from the person"},
      {"clutch", "button that takes the handle off the device, 0 (none) to 32; 2"},
      {"border", "share of the workspace beyond which the handle goes on by itself, 0.1 to 0.99; 0.9"},
      {"border_speed", "how fast, m/s, 0 (not at all) to 2; 0.1"},
      {"heat_time", "of the motors, s, 0.1 to 1000; 30"},
      {"patience", "for which a lost device may stay away, s, 0 to 3600; 10"},
      {"peak_force", "at most, N, 0.01 to 1000; what the device says"},
      {"continuous_force", "at most, N, 0.01 to 1000; what the device says"}};
  return options;
}

WorkspaceSettings workspaceSettings(const DeviceOptions& options) {
  WorkspaceSettings s;
  s.motion_scale = options.number("motion_scale", s.motion_scale, 0.01, 100);
  s.force_scale = options.number("force_scale", s.force_scale, 0.01, 100);
  s.turn = options.number("turn", 0, -360, 360) * std::numbers::pi / 180;
  s.clutch = static_cast<int>(options.number("clutch", s.clutch, 0, 32));
  s.border = options.number("border", s.border, 0.1, 0.99);
  s.border_speed = options.number("border_speed", s.border_speed, 0, 2);
  s.heat_time = options.number("heat_time", s.heat_time, 0.1, 1000);
  s.peak_force = options.number("peak_force", s.peak_force, 0.01, 1000);
  s.continuous_force = options.number("continuous_force", s.continuous_force, 0.01, 1000);
  s.patience = options.number("patience", s.patience, 0, 3600);
  return s;
}

DeviceLimits wantedLimits(DeviceLimits limits, const WorkspaceSettings& settings) {
  limits.peak_force = std::min(limits.peak_force, settings.peak_force);
  limits.continuous_force = std::min({limits.continuous_force, settings.continuous_force, limits.peak_force});
  return limits;
}

DeviceLimits worldLimits(const DriverInfo& info, const WorkspaceSettings& settings, double tick) {
  DeviceLimits out = wantedLimits(info.limits, settings);
  const double s = settings.motion_scale, f = settings.force_scale;
  const double slower = std::min(1.0, 1.0 / (info.rate * tick));
  out.peak_force /= f;
  out.continuous_force /= f;
  out.peak_torque /= f;
  out.stiffness *= slower / (s * f);
  out.damping *= slower / (s * f);
  if (out.peak_torque > 0.0) {  // what nobody feels cannot become unstable in a hand
    out.rotational_stiffness *= slower / f;
    out.rotational_damping *= slower / f;
  }
  out.workspace_radius *= s;
  return out;
}

HardwareDevice::HardwareDevice(std::shared_ptr<DeviceDriver> driver, const WorkspaceSettings& settings,
                               const Pose& start)
    : driver_(std::move(driver)),
      settings_(settings),
      limits_(wantedLimits(driver_->info().limits, settings)),
      frame_(expRotation(Vec3(0, 0, settings.turn))),
      heat_(limits_.peak_force, limits_.continuous_force, settings.heat_time),
      joint_(start) {
  state_.pose = start;
  state_.force_limit = state_.torque_limit = 0.0;
}

HardwareDevice::~HardwareDevice() { driver_->release(); }

const char* HardwareDevice::failure() const noexcept {
  const char* trouble = driver_->trouble();
  if (driver_->failed()) return trouble ? trouble : "the device failed";
  if (!given_up_.load(std::memory_order_relaxed)) return nullptr;
  return trouble ? trouble : "the device no longer answers";
}

DeviceReport HardwareDevice::report() const {
  DeviceReport out = counts_;
  const DriverInfo& info = driver_->info();
  out.name = info.name;
  out.facts = info.facts;
  out.notes = driver_->notes();
  out.heat = heat_.largest();
  out.hot_s = heat_.hotSeconds();
  return out;
}

// Written so that a NaN makes each comparison false.
bool HardwareDevice::isSane(const DriverSample& sample) const noexcept {
  const double norm = sample.pose.rotation.norm();
  return norm >= 0.5 && norm <= 2.0 && sample.pose.position.norm() <= 1e3 && sample.twist.head<3>().norm() <= 100.0 &&
         sample.twist.tail<3>().norm() <= 1000.0;
}

// Whether the sample is where a hand may have come from the last one, or has stayed long enough to be believed.
bool HardwareDevice::follows(const DriverSample& sample, double t, double dt) noexcept {
  // Within a tick any speed; after a silence what hands do; while it is somewhere else, hardly more.
  const double step_limit = std::max({kMaxStep, kMaxSpeed * dt, kHandSpeed * (t - seen_time_)});
  const double reach = step_limit + kSlowSpeed * (t - followed_time_);
  const Vec3 step = sample.pose.position - seen_;
  seen_ = sample.pose.position;
  seen_time_ = t;
  if (step.norm() > step_limit) steady_since_ = t;
  if ((sample.pose.position - last_.pose.position).norm() <= reach) return true;
  if (t - steady_since_ < kSteadyTime) return false;
  strayed_ = true;
  ++counts_.jumps;
  return true;
}

void HardwareDevice::join(const DriverSample& sample) noexcept {
  joint_ = state_.pose;
  device_joint_ = sample.pose;
  joined_ = true;
}

// Beyond the border the handle goes on outwards. Not before the device has been within it: it may rest at its edge.
void HardwareDevice::index(const DriverSample& sample, double dt) noexcept {
  drift_.setZero();
  const DriverInfo& info = driver_->info();
  if (!info.bounded || settings_.border_speed <= 0.0) return;
  const double radius = limits_.workspace_radius;
  const double distance = sample.pose.position.norm(), depth = distance - settings_.border * radius;
  if (depth <= 0.0) inside_ = true;
  if (depth <= 0.0 || !inside_) return;
  const double speed = settings_.border_speed * std::min(1.0, depth / ((1.0 - settings_.border) * radius));
  drift_.head<3>() = speed / distance * (frame_ * sample.pose.position);
  joint_.position += dt * drift_.head<3>();
  counts_.indexed_m += dt * speed;
}

void HardwareDevice::place(const DriverSample& sample, double dt) noexcept {
  const DriverInfo& info = driver_->info();
  index(sample, dt);
  const Quat rotation = frame_ * sample.pose.rotation * device_joint_.rotation.conjugate() * frame_.conjugate();
  const Pose pose{joint_.position + settings_.motion_scale * (frame_ * (sample.pose.position - device_joint_.position)),
                  (rotation * joint_.rotation).normalized()};
  Vec6 twist = turned(frame_, sample.twist, settings_.motion_scale);
  if (dt > 0.0) {
    const Vec6 change = poseDifference(pose, state_.pose) / dt;
    const double share = dt / (dt + kSpinTime);
    const Vec6 filtered = state_.twist + share * (change - state_.twist);
    if (!info.has_velocity) twist.head<3>() = filtered.head<3>() - drift_.head<3>();
    if (!info.has_spin) twist.tail<3>() = filtered.tail<3>();
  }
  state_.pose = pose;
  state_.twist = twist + drift_;
}

void HardwareDevice::updateGain(bool held, double dt) noexcept {
  gain_ = held ? gain_ - dt / kFadeTime : gain_ + dt / kReturnTime;
  gain_ = std::clamp(gain_, 0.0, 1.0);
  const double scale = settings_.force_scale;
  state_.force_limit = gain_ * heat_.limit() / scale;
  state_.torque_limit = gain_ * limits_.peak_torque / scale;
}

DeviceState HardwareDevice::sample(double t) noexcept {
  const double dt = started_ ? std::clamp(t - last_time_, 0.0, kLateTime) : 0.0;
  last_time_ = t;
  if (!started_) followed_time_ = t;
  started_ = true;
  DriverSample sample;
  bool good = driver_->read(sample) && isSane(sample);
  if (good) {
    sample.pose.rotation.normalize();
    if (!joined_) {
      join(sample);
      last_ = sample;
      seen_ = sample.pose.position;
      steady_since_ = followed_time_ = seen_time_ = t;
    }
    good = follows(sample, t, dt);
  }
  if (good) {
    last_ = sample;
    followed_time_ = t;
    state_.buttons = sample.buttons;
  }
  const bool late = !good && t - followed_time_ >= kLateTime;
  if (late && !lost_) ++counts_.losses;
  if (late) counts_.lost_s += dt;
  if (late && t - followed_time_ > settings_.patience) given_up_.store(true, std::memory_order_relaxed);
  const bool pressed = good && settings_.clutch > 0 && ((sample.buttons >> (settings_.clutch - 1)) & 1u) != 0;
  if (pressed && !clutched_) ++counts_.clutches;
  const bool held = late || pressed || (!good && (lost_ || clutched_)) || strayed_;
  if (good && !held && (lost_ || clutched_)) join(sample);
  if (good && strayed_) {
    join(sample);
    gain_ = 0.0;
  }
  if (good && !held) place(sample, dt);
  if (held || !good) state_.twist.setZero();
  lost_ = late || (lost_ && !good);
  if (good) clutched_ = pressed;
  if (good) strayed_ = false;
  updateGain(held || !joined_, dt);
  return state_;
}

void HardwareDevice::apply(const Vec6& wrench, double, double dt) noexcept {
  Vec6 out = Vec6::Zero();
  // nothing of what was meant for where the device has been
  if (wrench.allFinite() && !lost_ && joined_) out = turned(frame_.conjugate(), settings_.force_scale * wrench, 1.0);
  cutNorm(out.head<3>(), limits_.peak_force);  // rounding at most: the safety stage has done it
  cutNorm(out.tail<3>(), limits_.peak_torque);
  driver_->write(out);
  if (driver_->info().has_force) heat_.add(out.head<3>().norm(), dt);
}

}  // namespace palpate
