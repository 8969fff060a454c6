#pragma once

#include "palpate/math/types.h"

namespace palpate {

/// When the force swings by itself, and what is done about it.
struct OscillationSettings {
  bool enabled = true;
  double band = 6.0;     ///< slower is the hand's own motion [Hz]
  double window = 0.08;  ///< over which power is averaged [s]
  int windows = 4;       ///< in a row that must be active
  double power = 0.006;  ///< that the device gives the hand in an active one, at least [W]
  double fade = 0.1;     ///< time in which the force leaves [s]
  double rest = 0.3;     ///< for which it stays away [s]
  double ramp = 0.5;     ///< time in which it would come back whole [s]
  double share = 0.5;    ///< of what it was that comes back
  double recovery = 60;  ///< time in which a share of 0 would grow to 1 again [s]
};

/// What the detector remembers.
struct OscillationState {
  // Of the wrench, and of the device's rate of displacement: two low passes in a row of each.
  Vec6 wrench_low = Vec6::Zero(), wrench_lower = Vec6::Zero();
  Vec6 rate_low = Vec6::Zero(), rate_lower = Vec6::Zero();
  double time = 0.0;   ///< of the window [s]
  double band = 0.0;   ///< energy given above the band's edge in it [J]
  double total = 0.0;  ///< energy given in it [J]
  int active = 0;      ///< windows in a row
  bool started = false;
  double gain = 1.0;
  double ceiling = 1.0;  ///< to which the gain returns
  double rest = 0.0;     ///< until it does [s]
};

/// Finds a limit cycle of device and hand on the one side and the rendered force on the other, and stops it.
/// A hand is passive above its own motion: what swings faster, again and again, takes its energy from the force. So a
/// window is active when the sent wrench w gave the device, with its displacement dx in each tick,
///   sum w . dx >= power * window   and   sum hp(w) . hp(dx) >= power * window,
/// hp: two high passes of first order at `band`. The first leaves out a contact or a slip that is driven by the hand,
/// which costs the hand energy in all; the second leaves out weight that sinks and tissue that gives back slowly.
/// After `windows` active ones in a row the force fades out, rests, and returns to `share` of what it was; that grows
/// again slowly.
class OscillationGuard {
 public:
  /// @throws InputError for a time or share out of range
  explicit OscillationGuard(const OscillationSettings& settings);

  void start() noexcept { state_ = {}; }
  /// After a gap in time: what was before says nothing.
  void forget() noexcept;
  /// @param sent          wrench that was held on the device since the last call [N; N m]
  /// @param displacement  of the device since then [m; rad]
  /// @param dt            [s]
  /// @return whether a swing was found in this tick
  bool update(const Vec6& sent, const Vec6& displacement, double dt) noexcept;
  /// By which the wrench is multiplied: 1 as long as nothing was found.
  double gain() const noexcept { return state_.gain; }

  const OscillationState& state() const noexcept { return state_; }
  void restore(const OscillationState& state) noexcept { state_ = state; }

 private:
  bool found(const Vec6& sent, const Vec6& displacement, double dt) noexcept;
  void updateGain(double dt) noexcept;

  OscillationSettings settings_;
  OscillationState state_;
};

}  // namespace palpate
