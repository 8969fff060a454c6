#include "palpate/haptics/safety.h"

#include <algorithm>

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

SafetyChain::SafetyChain(const SafetySettings& settings) : settings_(settings) {
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
}

Vec6 SafetyChain::start(const Vec6& wrench) noexcept {
  TickFlags flags;
  state_.previous = wrench.allFinite() ? clamp(wrench, flags) : Vec6(Vec6::Zero());
  state_.watchdog_gain = state_.gap_gain = state_.end_gain = 1.0;
  state_.ending = false;
  return settings_.start_ramp > 0.0 ? Vec6(Vec6::Zero()) : state_.previous;
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

  out.wrench = clamp(out.wrench, out.flags);
  out.wrench = limitSlew(out.wrench, input.dt, out.flags);
  state_.previous = out.wrench;
  const double ramp = rampGain(input, out.flags);
  if (ramp < 1.0) out.wrench *= ramp;
  const double end = endGain(input.dt, out.flags);
  if (end < 1.0) out.wrench *= end;
  return out;
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
  state_.watchdog_gain = std::clamp(state_.watchdog_gain + (stale ? -change : change), 0.0, 1.0);
  if (state_.watchdog_gain < 1.0) flags.set(TickFlag::model_stale);
  return state_.watchdog_gain;
}

Vec6 SafetyChain::clamp(const Vec6& wrench, TickFlags& flags) const noexcept {
  Vec6 result = wrench;
  if (cutNorm(result.head<3>(), settings_.peak_force)) flags.set(TickFlag::force_clamped);
  if (cutNorm(result.tail<3>(), settings_.peak_torque)) flags.set(TickFlag::torque_clamped);
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
