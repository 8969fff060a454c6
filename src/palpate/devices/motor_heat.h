#pragma once

#include <algorithm>

namespace palpate {

/// Heat of a device's motors and the force that it still allows.
///   tau dh/dt = F^2 / Fc^2 - h,   limit: Fp while h <= 0.8, then in a straight line down to Fc at h = 1
/// So h stays at most 1, and for ever at most Fc is held.
class MotorHeat {
 public:
  /// @param peak, continuous  Fp >= Fc > 0 [N]
  /// @param time              tau [s] > 0
  MotorHeat(double peak, double continuous, double time)
      : peak_(peak), continuous_(std::min(continuous, peak)), time_(time) {}

  /// @param force  held for dt [s], at least 0 [N]
  void add(double force, double dt) noexcept {
    const double load = force * force / (continuous_ * continuous_);
    heat_ = (time_ * heat_ + dt * load) / (time_ + dt);
    largest_ = std::max(largest_, heat_);
    if (limit() < peak_) hot_ += dt;
  }

  /// Largest force now [N].
  double limit() const noexcept {
    const double share = std::clamp((1.0 - heat_) / (1.0 - kWarm), 0.0, 1.0);
    return continuous_ + share * (peak_ - continuous_);
  }
  double heat() const noexcept { return heat_; }
  double largest() const noexcept { return largest_; }
  double hotSeconds() const noexcept { return hot_; }

 private:
  static constexpr double kWarm = 0.8;
  double peak_, continuous_, time_;
  double heat_ = 0.0, largest_ = 0.0, hot_ = 0.0;
};

}  // namespace palpate
