#include "palpate/haptics/safety.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/common/error.h"
#include "palpate/math/cut_norm.h"

namespace palpate {
namespace {

void requireNotNegative(double value, const char* key) {
  if (!(value >= 0.0)) throw InputError("safety", key, "must not be negative");
}

}  // namespace

SafetySettings safetyForDevice(SafetySettings settings, const DeviceLimits& limits) {
  settings.peak_force = limits.peak_force;
  settings.peak_torque = limits.peak_torque;
  return settings;
}

double modelAgeLimit(double visual_step, int latency) { return (latency + 5) * visual_step; }

SafetyChain::SafetyChain(const SafetySettings& settings) : settings_(settings), guard_(settings.oscillation) {
  requireNotNegative(settings.peak_force, "peak_force");
  requireNotNegative(settings.peak_torque, "peak_torque");
  requireNotNegative(settings.max_slew, "max_slew");
  requireNotNegative(settings.max_torque_slew, "max_torque_slew");
  requireNotNegative(settings.start_ramp, "start_ramp");
  requireNotNegative(settings.model_age_limit, "model_age_limit");
  requireNotNegative(settings.model_decay, "model_decay");
  requireNotNegative(settings.gap_limit, "gap_limit");
  requireNotNegative(settings.gap_ramp, "gap_ramp");
  requireNotNegative(settings.end_fade, "end_fade");
  requireNotNegative(settings.passivity.allowance, "passivity.allowance");
  requireNotNegative(settings.passivity.max_damping, "passivity.max_damping");
  requireNotNegative(settings.passivity.max_rotational_damping, "passivity.max_rotational_damping");
  requireNotNegative(settings.passivity.quiet_speed, "passivity.quiet_speed");
  requireNotNegative(settings.passivity.quiet_spin, "passivity.quiet_spin");
  const PresenceSettings& presence = settings.presence;
  if (presence.dead_man < 0 || presence.dead_man > 32) throw InputError("safety", "dead_man", "must be 0 to 32");
  requireNotNegative(presence.push, "presence.push");
  requireNotNegative(presence.push_time, "presence.push_time");
  requireNotNegative(presence.push_travel, "presence.push_travel");
  requireNotNegative(presence.calm_speed, "presence.calm_speed");
  requireNotNegative(presence.calm_time, "presence.calm_time");
  requireNotNegative(presence.gate_ramp, "presence.gate_ramp");
  requireNotNegative(presence.workspace, "workspace");
  requireNotNegative(presence.frozen_limit, "frozen_limit");
  requireNotNegative(presence.frozen_force, "presence.frozen_force");
  requireNotNegative(presence.fade, "presence.fade");
}

Vec6 SafetyChain::start(const Vec6& wrench, const Vec3& home) noexcept {
  TickFlags flags;
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const PresenceSettings& presence = settings_.presence;
  state_ = {};
  state_.previous = wrench.allFinite() ? clamp(wrench, kNone, kNone, flags) : Vec6(Vec6::Zero());
  state_.home = home;
  guard_.start();
  if (presence.start_gate) state_.gate = Gate::closed;
  if (presence.start_gate || presence.dead_man > 0) state_.presence_gain = 0.0;
  const bool from_zero = settings_.start_ramp > 0.0 || state_.presence_gain <= 0.0;
  state_.sent = from_zero ? Vec6(Vec6::Zero()) : state_.previous;
  return state_.sent;
}

SafetyState SafetyChain::state() const noexcept {
  SafetyState out = state_;
  out.oscillation = guard_.state();
  return out;
}

void SafetyChain::restore(const SafetyState& state) noexcept {
  state_ = state;
  guard_.restore(state.oscillation);
}

SafetyChain::Output SafetyChain::process(const Input& input, const PassivityObserver& observer) noexcept {
  Output out{input.wrench, {}};
  if (!out.wrench.allFinite()) {
    out.wrench.setZero();
    out.flags.set(TickFlag::wrench_non_finite);
  }
  out.wrench *= updateWatchdog(input.model_age, input.dt, out.flags);

  const Vec6 damping = passivityWrench(settings_.passivity, observer, input.device_twist, input.dt);
  if (!damping.isZero(0.0)) out.flags.set(TickFlag::passivity_damped);
  out.wrench += damping;

  out.wrench = clamp(out.wrench, input.force_limit, input.torque_limit, out.flags);
  out.wrench = limitSlew(out.wrench, input.dt, out.flags);
  state_.previous = out.wrench;
  const double ramp = rampGain(input, out.flags);
  if (ramp < 1.0) out.wrench *= ramp;
  const double presence = presenceGain(input, out.flags);
  if (presence < 1.0) out.wrench *= presence;
  const double swing = swingGain(input, out.flags);
  if (swing < 1.0) out.wrench *= swing;
  out.wrench.z() += gatePush();
  const double end = endGain(input.dt, out.flags);
  if (end < 1.0) out.wrench *= end;
  state_.sent = out.wrench;
  return out;
}

double SafetyChain::swingGain(const Input& input, TickFlags& flags) noexcept {
  const double dt = std::max(input.dt, input.since_last);
  if (flags.has(TickFlag::gap)) guard_.forget();
  if (!flags.has(TickFlag::gap) && guard_.update(state_.sent, input.displacement, dt)) {
    flags.set(TickFlag::oscillation);
  }
  if (guard_.gain() < 1.0) flags.set(TickFlag::calmed);
  return guard_.gain();
}

// Without hands on a device that works the force leaves; with them it comes back, slowly the first time.
double SafetyChain::presenceGain(const Input& input, TickFlags& flags) noexcept {
  const PresenceSettings& s = settings_.presence;
  const bool held = isHeld(input, flags);
  if (s.start_gate) {
    if (flags.has(TickFlag::gap) || (!held && state_.presence_gain <= 0.0)) state_.gate = Gate::closed;
    if (state_.gate != Gate::open) {
      updateGate(input, held);
      flags.set(TickFlag::gate_closed);
    }
  }
  const bool may = held && state_.gate == Gate::open;
  const double time = !may ? s.fade : s.start_gate ? s.gate_ramp : settings_.gap_ramp;
  const double change = time > input.dt ? input.dt / time : 1.0;
  state_.presence_gain = std::clamp(state_.presence_gain + (may ? change : -change), 0.0, 1.0);
  if (state_.presence_gain < 1e-9) state_.presence_gain = 0.0;  // what rounding leaves
  if (may && state_.presence_gain < 1.0) flags.set(TickFlag::ramping);
  return state_.presence_gain;
}

bool SafetyChain::isHeld(const Input& input, TickFlags& flags) noexcept {
  const int button = settings_.presence.dead_man;
  const bool pressed = button == 0 || ((input.buttons >> (button - 1)) & 1u) != 0;
  if (!pressed) flags.set(TickFlag::button_released);
  const bool inside = isInside(input.position);
  if (!inside) flags.set(TickFlag::outside_workspace);
  const bool works = input.device_good && !isFrozen(input);
  if (!works) flags.set(TickFlag::device_lost);
  return pressed && inside && works;
}

// A hand and the noise of a sensor never leave every bit of a pushed device as it was.
bool SafetyChain::isFrozen(const Input& input) noexcept {
  const PresenceSettings& s = settings_.presence;
  if (!input.displacement.isZero(0.0)) state_.same_pose = 0.0;
  // once frozen, it stays so until it moves: the force that is gone says nothing
  else if (state_.same_pose > s.frozen_limit || state_.sent.head<3>().norm() >= s.frozen_force) {
    state_.same_pose += input.dt;
  }
  return state_.same_pose > s.frozen_limit;
}

bool SafetyChain::isInside(const Vec3& position) noexcept {
  constexpr double kBack = 0.95;  // of the radius, within which it counts as inside again
  const double radius = settings_.presence.workspace * (state_.outside ? kBack : 1.0);
  state_.outside = !((position - state_.home).norm() <= radius);
  return !state_.outside;
}

// Calm for a while, then a push: who does not give way has hold of it.
void SafetyChain::updateGate(const Input& input, bool may_push) noexcept {
  const PresenceSettings& s = settings_.presence;
  const bool calm = input.device_twist.head<3>().norm() <= s.calm_speed;
  if (!may_push || (state_.gate == Gate::closed && !calm)) {
    state_.gate = Gate::closed;
    state_.gate_time = 0.0;
    return;
  }
  state_.gate_time += input.dt;
  if (state_.gate == Gate::closed && state_.gate_time >= s.calm_time) {
    state_.gate = Gate::pushing;
    state_.gate_time = 0.0;
    state_.pushed_from = input.position;
  } else if (state_.gate == Gate::pushing) {
    const bool stays = (input.position - state_.pushed_from).norm() <= s.push_travel;
    if (stays && state_.gate_time < s.push_time) return;
    state_.gate = stays ? Gate::open : Gate::closed;
    state_.gate_time = 0.0;
  }
}

double SafetyChain::gatePush() const noexcept {
  if (state_.gate != Gate::pushing) return 0.0;
  const PresenceSettings& s = settings_.presence;
  return s.push * std::sin(std::numbers::pi * std::min(1.0, state_.gate_time / s.push_time));
}

void SafetyChain::comeBack() noexcept {
  if (!state_.ending) return;
  state_.ending = false;
  state_.end_gain = 1.0;
  state_.gap_gain = 0.0;
}

// Whatever happened meanwhile, the device may be anywhere and the force with it.
double SafetyChain::rampGain(const Input& input, TickFlags& flags) noexcept {
  double gain = state_.gap_gain;
  state_.gap_gain = settings_.gap_ramp > input.dt ? std::min(1.0, gain + input.dt / settings_.gap_ramp) : 1.0;
  if (!(input.since_last <= settings_.gap_limit)) {
    gain = state_.gap_gain = 0.0;
    flags.set(TickFlag::gap);
  }
  if (input.since_start < settings_.start_ramp) {
    gain = std::min(gain, std::max(0.0, input.since_start / settings_.start_ramp));
  }
  if (gain < 1.0) flags.set(TickFlag::ramping);
  return gain;
}

double SafetyChain::endGain(double dt, TickFlags& flags) noexcept {
  if (!state_.ending) return 1.0;
  flags.set(TickFlag::fading);
  state_.end_gain = settings_.end_fade > dt ? std::max(0.0, state_.end_gain - dt / settings_.end_fade) : 0.0;
  if (state_.end_gain < 1e-9) state_.end_gain = 0.0;  // what rounding leaves
  return state_.end_gain;
}

double SafetyChain::updateWatchdog(double model_age, double dt, TickFlags& flags) noexcept {
  const bool stale = !(model_age <= settings_.model_age_limit);
  const double change = settings_.model_decay > dt ? dt / settings_.model_decay : 1.0;
  // While the force leaves, nobody makes models any more.
  if (!state_.ending) state_.watchdog_gain = std::clamp(state_.watchdog_gain + (stale ? -change : change), 0.0, 1.0);
  if (state_.watchdog_gain < 1.0) flags.set(TickFlag::model_stale);
  return state_.watchdog_gain;
}

Vec6 SafetyChain::clamp(const Vec6& wrench, double force_limit, double torque_limit, TickFlags& flags) const noexcept {
  Vec6 result = wrench;
  if (cutNorm(result.head<3>(), settings_.peak_force)) flags.set(TickFlag::force_clamped);
  if (cutNorm(result.tail<3>(), settings_.peak_torque)) flags.set(TickFlag::torque_clamped);
  const bool force = cutNorm(result.head<3>(), force_limit), torque = cutNorm(result.tail<3>(), torque_limit);
  if (force || torque) flags.set(TickFlag::device_limited);
  return result;
}

Vec6 SafetyChain::limitSlew(const Vec6& wrench, double dt, TickFlags& flags) const noexcept {
  Vec6 change = wrench - state_.previous;
  const bool force = cutNorm(change.head<3>(), settings_.max_slew * dt);
  const bool torque = cutNorm(change.tail<3>(), settings_.max_torque_slew * dt);
  if (!force && !torque) return wrench;
  flags.set(TickFlag::slew_limited);
  return state_.previous + change;
}

}  // namespace palpate
