#pragma once

#include <limits>

#include "palpate/haptics/device_state.h"
#include "palpate/haptics/oscillation.h"
#include "palpate/haptics/passivity.h"
#include "palpate/haptics/tick_flags.h"

namespace palpate {

/// When the force may be there at all: a person has hold of a device that works, within its workspace.
struct PresenceSettings {
  int dead_man = 0;           ///< button that must be pressed, 1 to 32; 0: none
  bool start_gate = false;    ///< first a small push finds out whether somebody holds the device
  double push = 0.1;          ///< of the gate, upwards [N]
  double push_time = 0.2;     ///< [s]
  double push_travel = 0.01;  ///< farther than this nobody holds it [m]
  double calm_speed = 0.1;    ///< of the device, before the push [m/s]
  double calm_time = 0.3;     ///< for which it is calm [s]
  double gate_ramp = 1.5;     ///< force fades in during this time behind the gate [s]
  double workspace = std::numeric_limits<double>::infinity();     ///< distance from the start [m]
  double frozen_limit = std::numeric_limits<double>::infinity();  ///< same pose for so long while it is pushed [s]
  double frozen_force = 0.1;                                      ///< from which on it counts as pushed [N]
  double fade = 0.1;  ///< time in which the force leaves where it may not be [s]
};

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
  OscillationSettings oscillation;
  PresenceSettings presence;
};

/// The settings with the peaks of a device.
SafetySettings safetyForDevice(SafetySettings settings, const DeviceLimits& limits);

/// Age [s] at which a model is stale: (latency + 5) visual steps, four more than what the latency explains.
double modelAgeLimit(double visual_step, int latency);

/// What the start gate is at.
enum class Gate : std::uint8_t { open, closed, pushing };

/// What the safety chain remembers.
struct SafetyState {
  Vec6 previous = Vec6::Zero();  ///< wrench of the last tick before the start ramp [N; N m]
  double watchdog_gain = 1.0;    ///< 0: faded out
  double gap_gain = 1.0;         ///< 0: a gap has just been
  double end_gain = 1.0;         ///< 0: the force has left
  bool ending = false;           ///< it leaves, or has left
  Vec6 sent = Vec6::Zero();      ///< by the last tick [N; N m]
  OscillationState oscillation;
  double presence_gain = 1.0;  ///< 0: the force may not be there
  Gate gate = Gate::open;
  double gate_time = 0.0;           ///< for which the device is calm, or is pushed [s]
  Vec3 home = Vec3::Zero();         ///< of the device, at the start [m]
  Vec3 pushed_from = Vec3::Zero();  ///< [m]
  double same_pose = 0.0;           ///< for which the device's pose has not changed by a bit while it was pushed [s]
  bool outside = false;             ///< of the workspace
};

/// non-finite to zero -> watchdog -> passivity controller -> norm clamp -> slew limit -> ramps -> presence ->
/// oscillation -> fading at the end (-> push of the start gate, alone)
class SafetyChain {
 public:
  /// @throws InputError for a limit that is negative or not a number
  explicit SafetyChain(const SafetySettings& settings);

  struct Input {
    Vec6 wrench;                       ///< wanted on the device [N; N m]
    double since_start;                ///< [s]
    double model_age;                  ///< [s]
    double dt;                         ///< [s]
    Vec6 device_twist;                 ///< [m/s; rad/s]
    double since_last = 0.0;           ///< from the tick before [s]; dt, or more where ticks were missed
    Vec6 displacement = Vec6::Zero();  ///< of the device since the tick before [m; rad]
    Vec3 position = Vec3::Zero();      ///< of the device [m]
    std::uint32_t buttons = 0;         ///< as DeviceState has them
    bool device_good = true;           ///< the sample is one, and no stand-in
    double force_limit = std::numeric_limits<double>::infinity();   ///< of the device now [N]
    double torque_limit = std::numeric_limits<double>::infinity();  ///< [N m]
  };
  struct Output {
    Vec6 wrench;
    TickFlags flags;
  };

  /// Forgets the past; the first wrench may be this one without a slew.
  /// @param home  of the device: middle of its workspace [m]
  /// @return what is sent at the start
  Vec6 start(const Vec6& wrench, const Vec3& home = Vec3::Zero()) noexcept;
  Output process(const Input& input, const PassivityObserver& observer) noexcept;

  /// From the next tick on the force leaves, within `end_fade`.
  void leave() noexcept { state_.ending = true; }
  /// It has left: zero is sent.
  bool gone() const noexcept { return state_.ending && state_.end_gain <= 0.0; }
  /// No force is there, as none may be: what the device says now may be anything.
  bool absent() const noexcept { return state_.presence_gain <= 0.0; }
  /// Where it leaves or has left, it starts from zero with the next tick, as after a gap.
  void comeBack() noexcept;

  SafetyState state() const noexcept;
  void restore(const SafetyState& state) noexcept;

  const SafetySettings& settings() const noexcept { return settings_; }
  /// Age at which a model is stale from the next tick on [s].
  void setModelAgeLimit(double limit) noexcept { settings_.model_age_limit = limit; }

 private:
  double updateWatchdog(double model_age, double dt, TickFlags& flags) noexcept;
  double rampGain(const Input& input, TickFlags& flags) noexcept;
  double endGain(double dt, TickFlags& flags) noexcept;
  double presenceGain(const Input& input, TickFlags& flags) noexcept;
  bool isHeld(const Input& input, TickFlags& flags) noexcept;
  bool isFrozen(const Input& input) noexcept;
  bool isInside(const Vec3& position) noexcept;
  void updateGate(const Input& input, bool may_push) noexcept;
  double gatePush() const noexcept;
  double swingGain(const Input& input, TickFlags& flags) noexcept;
  Vec6 clamp(const Vec6& wrench, double force_limit, double torque_limit, TickFlags& flags) const noexcept;
  Vec6 limitSlew(const Vec6& wrench, double dt, TickFlags& flags) const noexcept;

  SafetySettings settings_;
  SafetyState state_;
  OscillationGuard guard_;
};

}  // namespace palpate
