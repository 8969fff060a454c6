#pragma once

#include "palpate/haptics/device_state.h"
#include "palpate/haptics/passivity.h"
#include "palpate/haptics/tick_flags.h"

namespace palpate {

/// Last stage before the device. An infinite limit switches a stage off.
struct SafetySettings {
  double peak_force = 3.3;        ///< norm of the force is cut to this, direction kept [N]
  double peak_torque = 0.1;       ///< [N m]; 0: no torque at all
  double max_slew = 3000.0;       ///< largest change of the force [N/s]; a wall of 1 kN/m struck at 1 m/s needs a third
  double max_torque_slew = 90.0;  ///< [N m/s]
  double start_ramp = 0.0;        ///< force fades in during this time after the start [s]; 0 for simulated devices
  double model_age_limit = 0.25;  ///< watchdog: wrench fades out while the model is older [s]; see modelAgeLimit()
  double model_decay = 0.1;       ///< time of that fading, and of fading in again [s]
  double gap_limit = 0.05;        ///< longer from one tick to the next is a gap: force starts from zero [s]
  double gap_ramp = 0.5;          ///< force fades in during this time after a gap [s]
  double end_fade = 0.1;          ///< time in which the force leaves at the end of a run [s]
  PassivitySettings passivity;
};

/// The settings with the peaks of a device.
SafetySettings safetyForDevice(SafetySettings settings, const DeviceLimits& limits);

/// Age [s] at which a model is stale: (latency + 5) visual steps, four more than what the latency explains.
double modelAgeLimit(double visual_step, int latency);

/// What the safety chain remembers.
struct SafetyState {
  Vec6 previous = Vec6::Zero();  ///< wrench of the last tick before the start ramp [N; N m]
  double watchdog_gain = 1.0;    ///< 0: faded out
  double gap_gain = 1.0;         ///< 0: a gap has just been
  double end_gain = 1.0;         ///< 0: the force has left
  bool ending = false;           ///< it leaves, or has left
};

/// non-finite to zero -> watchdog -> passivity controller -> norm clamp -> slew limit -> ramps -> fading at the end
class SafetyChain {
 public:
  /// @throws InputError for a limit that is negative or not a number
  explicit SafetyChain(const SafetySettings& settings);

  struct Input {
    Vec6 wrench;              ///< wanted on the device [N; N m]
    double since_start;       ///< [s]
    double model_age;         ///< [s]
    double dt;                ///< [s]
    Vec6 device_twist;        ///< [m/s; rad/s]
    double since_last = 0.0;  ///< from the tick before [s]; dt, or more where ticks were missed
  };
  struct Output {
    Vec6 wrench;
    TickFlags flags;
  };

  /// Forgets the past; the first wrench may be this one without a slew.
  /// @return what is sent at the start
  Vec6 start(const Vec6& wrench) noexcept;
  Output process(const Input& input, const PassivityObserver& observer) noexcept;

  /// From the next tick on the force leaves, within `end_fade`.
  void leave() noexcept { state_.ending = true; }
  /// It has left: zero is sent.
  bool gone() const noexcept { return state_.ending && state_.end_gain <= 0.0; }
  /// Where it leaves or has left, it starts from zero with the next tick, as after a gap.
  void comeBack() noexcept;

  const SafetyState& state() const noexcept { return state_; }
  void restore(const SafetyState& state) noexcept { state_ = state; }

  const SafetySettings& settings() const noexcept { return settings_; }
  /// Age at which a model is stale from the next tick on [s].
  void setModelAgeLimit(double limit) noexcept { settings_.model_age_limit = limit; }

 private:
  double updateWatchdog(double model_age, double dt, TickFlags& flags) noexcept;
  double rampGain(const Input& input, TickFlags& flags) noexcept;
  double endGain(double dt, TickFlags& flags) noexcept;
  Vec6 clamp(const Vec6& wrench, TickFlags& flags) const noexcept;
  Vec6 limitSlew(const Vec6& wrench, double dt, TickFlags& flags) const noexcept;

  SafetySettings settings_;
  SafetyState state_;
};

}  // namespace palpate
