#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Two times closer than this are the same instant [s].
inline constexpr double kSameInstant = 1e-9;

/// Where a path is at a time, relative to its start: p = p_start + position, R = exp(rotation) R_start, world frame.
struct PathKey {
  double time = 0.0;             ///< [s]
  Vec3 position = Vec3::Zero();  ///< [m]
  Vec3 rotation = Vec3::Zero();  ///< rotation vector [rad]; more than a turn is allowed
};

/// Random motion within a band of frequencies, on top of a path: along each axis a sum of sines of equal amplitude, one
/// in each of kSines equal parts of the band. It fades in and out over a quarter of its time, half a second at most.
struct Wander {
  static constexpr int kSines = 12;
  double band = 0;               ///< highest frequency [Hz]; 0: none
  Vec3 position = Vec3::Zero();  ///< root mean square along each axis [m]
  Vec3 rotation = Vec3::Zero();  ///< the same of the rotation vector [rad]
  double from = 0, to = 0;       ///< [s]
  std::uint32_t seed = 1;
};

enum class Interpolation {
  linear,  ///< constant velocity between keys; at a key the right-hand one
  smooth,  ///< at rest in every key, minimum jerk in between
};

/// Motion through keys. Rests in the first key before it and in the last one after it.
class Path {
 public:
  /// Rests at the start.
  Path() = default;
  /// @throws InputError for values that are not finite or times that do not increase
  explicit Path(std::vector<PathKey> keys, Interpolation interpolation = Interpolation::linear,
                const Wander& wander = {});

  struct Point {
    Pose pose;   ///< world
    Vec6 twist;  ///< world [m/s; rad/s]
  };
  /// Point at time t of a path that starts at `start`.
  Point at(double t, const Pose& start) const noexcept;

  /// Time of the last key [s]; 0 without keys.
  double duration() const noexcept { return keys_.empty() ? 0.0 : keys_.back().time; }

 private:
  std::vector<PathKey> keys_;
  Interpolation interpolation_ = Interpolation::linear;
  struct Sine {
    double rate, phase;  // [rad/s], [rad]
  };
  Wander wander_;
  std::array<std::array<Sine, Wander::kSines>, 6> sines_{};  // of each axis

  void addWander(double t, Vec6& offset, Vec6& rate) const noexcept;
};

}  // namespace palpate
