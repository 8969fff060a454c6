#pragma once

// Random poses, twists and handle models for the haptic loop.

#include <random>

#include "palpate/haptics/device_state.h"
#include "palpate/linearization/handle_model.h"
#include "palpate/math/rotation.h"

namespace palpate::test {

inline Vec3 randomVec3(std::mt19937& random, double scale) {
  std::uniform_real_distribution<double> uniform(-scale, scale);
  Vec3 v;
  for (int i = 0; i < 3; ++i) v[i] = uniform(random);
  return v;
}

inline Vec6 randomVec6(std::mt19937& random, double linear, double angular) {
  Vec6 v;
  v << randomVec3(random, linear), randomVec3(random, angular);
  return v;
}

inline Pose randomPose(std::mt19937& random, double distance, double angle) {
  return advance(Pose{}, randomVec6(random, distance, angle));
}

/// Neither symmetric nor definite; `arm` [m] scales the rotation rows and columns to the translation ones.
inline Mat6 randomMatrix(std::mt19937& random, double scale, double arm) {
  Mat6 m;
  for (int i = 0; i < 6; ++i) m.col(i) = randomVec6(random, scale, scale * arm) * (i < 3 ? 1.0 : arm);
  return m;
}

inline DeviceState deviceAt(const Pose& pose, const Vec6& twist = Vec6::Zero()) { return DeviceState{pose, twist, 0}; }

}  // namespace palpate::test
