#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/haptics/device_state.h"

namespace palpate {

/// What a sane device sample may be.
struct DeviceFilterSettings {
  double max_distance = 100.0;  ///< of the position from the world's origin [m]
  double max_speed = 100.0;     ///< [m/s]
  double max_spin = 1000.0;     ///< [rad/s]
};

/// What a filter remembers.
struct DeviceFilterState {
  DeviceState last;  ///< good sample
  std::uint64_t rejected = 0;
};

/// Keeps samples that are not numbers, or absurd, out of the haptic loop and the simulation: the last good sample
/// stands in for them. Every reader of a device has one of its own. Filtering twice changes nothing.
class DeviceFilter {
 public:
  explicit DeviceFilter(const DeviceFilterSettings& settings = {}) : settings_(settings) {}

  /// Forgets the past; `pose`, at rest, stands in until the first good sample.
  void reset(const Pose& pose) noexcept { state_ = {DeviceState{pose, Vec6::Zero(), 0}, 0}; }

  /// The sample with a unit quaternion, or the last good one.
  const DeviceState& accept(const DeviceState& sample) noexcept {
    if (isSane(sample)) {
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

  DeviceFilterSettings settings_;
  DeviceFilterState state_;
};

}  // namespace palpate
