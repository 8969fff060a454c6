#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "palpate/simulation/body_system.h"

namespace palpate {

/// What the random hands of `palpate stress` may do.
struct StressMotion {
  double step = 0.033;  ///< h, of the visual steps at which the hand is sampled [s]
  double speed = 2.0;   ///< at most [m/s]
  double spin = 10.0;   ///< at most [rad/s]
  double reach = 0.1;   ///< farthest from the start [m]
  double burst = 1.0;   ///< of the wild hand: violent [s]
  double calm = 0.5;    ///< of the wild hand: standing still [s]
  double ride = 6.0;    ///< of a ride: on the way, before it turns home [s]
  double home = 3.0;    ///< of a ride: at home, standing still [s]
};

/// Where the device is at each of some visual steps; it ends standing still.
struct StressBout {
  std::vector<DeviceTarget> way;
  int calm = 0;  ///< steps at the end in which the device stands still
};

/// Straight runs at up to full speed, turned round or broken off at random, with jumps, never far from the start; after
/// each burst it stands still where it is.
class WildHand {
 public:
  WildHand(const Pose& start, const StressMotion& motion, std::uint64_t seed);
  /// Goes on from where it is. @param most  steps; those of a whole bout or fewer
  StressBout bout(int most);

 private:
  void move();
  void teleport();

  Pose start_;
  StressMotion motion_;
  std::mt19937_64 random_;
  DeviceTarget state_;
};

/// One ride: what a hand that holds a device can do, and home again. Random velocities, each reached with an
/// acceleration that takes 0.1 s to full speed, within the reach and 2.5 rad of the start; no jumps. Then home at
/// 0.3 m/s and 3 rad/s at most, and it stands still exactly at the start.
StressBout rideOf(const Pose& start, const StressMotion& motion, std::uint64_t seed);

}  // namespace palpate
