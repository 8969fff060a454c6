#pragma once

#include "palpate/live/live_model.h"

namespace palpate {

/// Account of the energy at changes of live models (docs/live.md, energy). A new model tells another energy for the
/// same motion of the handle; where that is more, the tick would hand out what nobody has put in. What link and
/// material dissipate pays for it, up to a cap; what is not paid for is taken from the modes' motion, as far as that
/// goes: a contact that the old model did not know of brings energy that is there. A model that brings far too much is
/// refused.
class SwitchAccount {
 public:
  static constexpr double kCap = 0.02;         ///< of what is saved up [J]
  static constexpr double kAbsurdSpeed = 1.0;  ///< a rise by what the tool would have at it is refused [m/s]
  static constexpr int kMostRefused = 3;       ///< in a row; the next is taken at rest
  enum class Verdict { taken, damped, refused };

  /// Dissipated in a tick [J].
  void earn(double energy) noexcept;
  /// From one model to the next, for the same motion of the handle.
  /// @param before  energy by the model in use [J]
  /// @param state   of the new one; its speeds may be scaled down
  Verdict change(double before, const LiveModel& model, const Pose& pose, const Vec6& twist, const Vec3& gravity,
                 LiveState& state) noexcept;

  double saved() const noexcept { return saved_; }            ///< [J]
  double rises() const noexcept { return rises_; }            ///< sum of those that were let through [J]
  double falls() const noexcept { return falls_; }            ///< [J]
  double largestRise() const noexcept { return largest_; }    ///< [J]
  double dissipated() const noexcept { return dissipated_; }  ///< [J]

 private:
  void book(double rise) noexcept;

  double saved_ = kCap;
  double rises_ = 0, falls_ = 0, largest_ = 0, dissipated_ = 0;
  int refused_ = 0;  // in a row
};

}  // namespace palpate
