#pragma once

#include "palpate/math/types.h"

namespace palpate {

/// Energy that the virtual side has given to the hand since the start (time-domain observer after Hannaford and Ryu
/// 2002). The wrench is held during a tick, so wrench times displacement is exact, whatever the hand does within it.
/// Energy that the virtual side had at the start (a raised weight, a bent spring) may come out again without being
/// made.
class PassivityObserver {
 public:
  void reset() noexcept { *this = PassivityObserver(); }
  /// @param held_wrench   on the device, held since the last call [N; N m]
  /// @param displacement  tangent (dp, dtheta) of the device since then [m; rad]
  void add(const Vec6& held_wrench, const Vec6& displacement) noexcept {
    delivered_ += held_wrench.dot(displacement);
    peak_ = delivered_ > peak_ ? delivered_ : peak_;
  }
  /// Net energy given to the hand [J]; negative: the hand has put in more than it got back.
  double delivered() const noexcept { return delivered_; }
  /// Largest value of delivered() so far [J].
  double peak() const noexcept { return peak_; }

 private:
  double delivered_ = 0.0;
  double peak_ = 0.0;
};

/// Optional controller: while the observer says that more than the allowance came out, it adds damping to the wrench.
struct PassivitySettings {
  bool enabled = false;
  double allowance = 0.01;  ///< energy that may come out before the controller acts [J]
  // More is unstable at 1 kHz on a light device; both are the same share of what a stylus of 45 g has.
  double max_damping = 2.0;               ///< [N s/m]
  double max_rotational_damping = 0.005;  ///< [N m s/rad]
  // Below these a velocity is mostly noise, and its damping rests.
  double quiet_speed = 0.005;  ///< [m/s]
  double quiet_spin = 0.1;     ///< [rad/s]
};

/// Wrench that takes the surplus out within one tick, as far as the largest dampings go: the same share of both. Zero
/// where there is no surplus.
Vec6 passivityWrench(const PassivitySettings& settings, const PassivityObserver& observer, const Vec6& device_twist,
                     double dt) noexcept;

}  // namespace palpate
