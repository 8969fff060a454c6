#pragma once

#include <algorithm>
#include <cmath>

namespace fake {

/// A device's mass with a hand behind it: m a = f + kh (xt - x) + bh (vt - v) - b v, along three axes [m, N]. The hand
/// goes down by `depth` along one axis and up again, once a second, beginning at rest. By itself: it shares nothing
/// with the program under test.
struct Hand {
  double mass = 0.1, damping = 0.3, stiffness = 200.0, hand_damping = 5.0;
  double depth = 0.02;  // [m]
  int axis = 2;
  double x[3] = {0, 0, 0}, v[3] = {0, 0, 0}, t = 0;

  void advance(const double force[3], double dt) {
    const int steps = std::clamp(static_cast<int>(std::ceil(dt / 2.5e-4)), 1, 400);
    const double h = std::min(dt, 0.1) / steps, w = 2 * 3.14159265358979;
    for (int i = 0; i < steps; ++i) {
      t += h;
      for (int k = 0; k < 3; ++k) {
        const double where = k == axis ? -0.5 * depth * (1 - std::cos(w * t)) : 0;
        const double speed = k == axis ? -0.5 * depth * w * std::sin(w * t) : 0;
        const double pull = force[k] + stiffness * (where - x[k]) + hand_damping * (speed - v[k]) - damping * v[k];
        v[k] += h * pull / mass;
        x[k] += h * v[k];
      }
    }
  }
};

}  // namespace fake
