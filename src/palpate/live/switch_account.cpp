#include "palpate/live/switch_account.h"

#include <algorithm>
#include <cmath>

#include "palpate/live/live_tick.h"

namespace palpate {

void SwitchAccount::earn(double energy) noexcept {
  if (!(energy > 0) || !std::isfinite(energy)) return;
  dissipated_ += energy;
  saved_ = std::min(kCap, saved_ + energy);
}

void SwitchAccount::book(double rise) noexcept {
  saved_ = std::clamp(saved_ - rise, 0.0, kCap);
  (rise > 0 ? rises_ : falls_) += std::abs(rise);
  largest_ = std::max(largest_, rise);
  refused_ = 0;
}

SwitchAccount::Verdict SwitchAccount::change(double before, const LiveModel& model, const Pose& pose, const Vec6& twist,
                                             const Vec3& gravity, LiveState& state) noexcept {
  const double rise = liveEnergy(model, state, pose, twist, gravity) - before;
  if (rise <= saved_) {
    book(rise);
    return Verdict::taken;
  }
  // with the modes' speeds times s: a s^2 + b s + c over what is there
  LiveState still = state;
  still.speed.setZero();
  const double c = liveEnergy(model, still, pose, twist, gravity) - before - saved_;
  const double a = 0.5 * state.speed.squaredNorm();
  const double b = rise - saved_ - a - c;
  if (c + saved_ <= std::max(kCap, 0.5 * model.mass * kAbsurdSpeed * kAbsurdSpeed)) {
    const double share = c < 0 && a > 0 ? (-b + std::sqrt(std::max(0.0, b * b - 4.0 * a * c))) / (2.0 * a) : 0.0;
    state.speed *= std::clamp(share, 0.0, 1.0);
    book(liveEnergy(model, state, pose, twist, gravity) - before);
    return Verdict::damped;
  }
  if (++refused_ <= kMostRefused) return Verdict::refused;
  const std::int64_t now = state.index;
  state = startState(model);
  state.index = now;
  state.speed.setZero();
  book(liveEnergy(model, state, pose, twist, gravity) - before);
  return Verdict::damped;
}

}  // namespace palpate
