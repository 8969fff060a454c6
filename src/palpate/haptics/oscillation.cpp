#include "palpate/haptics/oscillation.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/common/error.h"

namespace palpate {
namespace {

/// What is left of x after two low passes in a row, each subtracted.
Vec6 highPassed(const Vec6& x, double share, Vec6& low, Vec6& lower) {
  const Vec6 once = x - low;
  low += share * once;
  const Vec6 twice = once - lower;
  lower += share * twice;
  return twice;
}

}  // namespace

OscillationGuard::OscillationGuard(const OscillationSettings& settings) : settings_(settings) {
  const auto require = [](bool good, const char* key) {
    if (!good) throw InputError("safety", key, "is out of range");
  };
  require(settings.band > 0 && std::isfinite(settings.band), "oscillation.band");
  require(settings.window > 0 && std::isfinite(settings.window), "oscillation.window");
  require(settings.windows >= 1, "oscillation.windows");
  require(settings.power > 0, "oscillation.power");
  require(settings.fade >= 0 && settings.rest >= 0 && settings.ramp >= 0, "oscillation.fade");
  require(settings.share >= 0 && settings.share <= 1, "oscillation.share");
  require(settings.recovery > 0, "oscillation.recovery");
}

void OscillationGuard::forget() noexcept {
  const OscillationState before = state_;
  state_ = {};
  state_.gain = before.gain;
  state_.ceiling = before.ceiling;
  state_.rest = before.rest;
}

bool OscillationGuard::update(const Vec6& sent, const Vec6& displacement, double dt) noexcept {
  if (!settings_.enabled) return false;
  const bool swings = found(sent, displacement, dt);
  if (swings) {
    forget();
    state_.ceiling = settings_.share * std::min(state_.gain, state_.ceiling);
    state_.rest = settings_.fade * state_.gain + settings_.rest;
  }
  updateGain(dt);
  return swings;
}

bool OscillationGuard::found(const Vec6& sent, const Vec6& displacement, double dt) noexcept {
  const double turn = 2.0 * std::numbers::pi * settings_.band * dt;
  const double share = turn / (1.0 + turn);
  const Vec6 rate = displacement / dt;
  if (!state_.started) {
    state_.started = true;
    state_.wrench_low = sent;
    state_.rate_low = rate;
  }
  const Vec6 fast_wrench = highPassed(sent, share, state_.wrench_low, state_.wrench_lower);
  const Vec6 fast_rate = highPassed(rate, share, state_.rate_low, state_.rate_lower);
  state_.band += dt * fast_wrench.dot(fast_rate);
  state_.total += sent.dot(displacement);
  state_.time += dt;
  if (state_.time < settings_.window - 0.5 * dt) return false;
  const double least = settings_.power * state_.time;
  state_.active = state_.band >= least && state_.total >= least ? state_.active + 1 : 0;
  state_.time = state_.band = state_.total = 0.0;
  return state_.active >= settings_.windows;
}

void OscillationGuard::updateGain(double dt) noexcept {
  if (state_.gain >= 1.0 && state_.ceiling >= 1.0) return;
  state_.ceiling = std::min(1.0, state_.ceiling + dt / settings_.recovery);
  if (state_.rest > 0.0) {
    state_.rest -= dt;
    state_.gain = settings_.fade > dt ? std::max(0.0, state_.gain - dt / settings_.fade) : 0.0;
  } else {
    state_.gain = settings_.ramp > dt ? std::min(state_.ceiling, state_.gain + dt / settings_.ramp) : state_.ceiling;
  }
}

}  // namespace palpate
