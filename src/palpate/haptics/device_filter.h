#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "palpate/haptics/device_state.h"

namespace palpate {

/// What a sane device sample may be.
struct DeviceFilterSettings {
  double max_distance = 100.0;  ///< of the position from the world's origin [m]
  double max_speed = 100.0;     ///< [m/s]
  double max_spin = 1000.0;     ///< [rad/s]
  // No hand is faster, from one sample to the next.
  double max_travel = 20.0;  ///< change of position [m/s]
  double max_turn = 100.0;   ///< change of rotation [rad/s]
};

/// What a filter remembers.
struct DeviceFilterState {
  DeviceState last;  ///< good sample
  std::uint64_t rejected = 0;
};

/// Keeps samples that are not numbers, absurd, or too far from the one before out of the haptic loop and the
/// simulation: the last good sample stands in for them. Every reader of a device has one of its own. Filtering twice
/// changes nothing.
class DeviceFilter {
 public:
  explicit DeviceFilter(const DeviceFilterSettings& settings = {}) : settings_(settings) {}

  /// Forgets the past; `pose`, at rest, stands in until the first good sample.
  void reset(const Pose& pose) noexcept { state_ = {DeviceState{pose, Vec6::Zero(), 0}, 0}; }

  /// The sample with a unit quaternion, or the last good one.
  /// @param elapsed  since the last call [s]; infinite: it may have come from anywhere
  const DeviceState& accept(const DeviceState& sample,
                            double elapsed = std::numeric_limits<double>::infinity()) noexcept {
    if (isSane(sample) && isNear(sample.pose, elapsed)) {
      state_.last = sample;
      // A quaternion that is a unit one already keeps its bits, so that a replay is exact.
      if (std::abs(sample.pose.rotation.squaredNorm() - 1.0) > 1e-12) state_.last.pose.rotation.normalize();
    } else {
      ++state_.rejected;
    }
    return state_.last;
  }

  const DeviceFilterState& state() const noexcept { return state_; }
  void restore(const DeviceFilterState& state) noexcept { state_ = state; }

  std::uint64_t rejected() const noexcept { return state_.rejected; }

 private:
  // Written so that a NaN makes each comparison false.
  bool isSane(const DeviceState& sample) const noexcept {
    const double norm = sample.pose.rotation.norm();
    return sample.pose.position.norm() <= settings_.max_distance && norm >= 0.5 && norm <= 2.0 &&
           sample.twist.head<3>().norm() <= settings_.max_speed && sample.twist.tail<3>().norm() <= settings_.max_spin;
  }

  bool isNear(const Pose& pose, double elapsed) const noexcept {
    constexpr double kStep = 0.005, kTurn = 0.1;  // [m], [rad]: coarse sensors
    const double reach = kStep + settings_.max_travel * elapsed, turn = kTurn + settings_.max_turn * elapsed;
    if (!((pose.position - state_.last.pose.position).norm() <= reach)) return false;
    if (turn >= std::numbers::pi) return true;
    const double cosine = std::abs(pose.rotation.dot(state_.last.pose.rotation)) / pose.rotation.norm();
    return cosine >= std::cos(0.5 * turn);
  }

  DeviceFilterSettings settings_;
  DeviceFilterState state_;
};

}  // namespace palpate
