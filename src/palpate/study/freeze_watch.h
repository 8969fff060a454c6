#pragma once

#include <deque>
#include <vector>

#include "palpate/simulation/world.h"

namespace palpate {

/// Watches for bodies that stand still although something moves them. A body is frozen when no node has moved by more
/// than a micrometer in any step of the last 0.3 s, although
/// - in each of them its velocities would have carried a node by ten micrometers, and motion was cut short; or
/// - it is the tool, its handle is 5 mm or 0.3 rad farther from the device than at the start, and the device has moved
///   by as much in that time, or nothing touches or holds the tool. Motion with which the link's pull does not change,
///   as it is saturated, does not count.
class FreezeWatch {
 public:
  /// @param start  of the device: where the handle now hangs from it counts as no distance
  /// @param step   h [s]
  FreezeWatch(const World& world, const Pose& start, double step);

  /// The world was set to another state: the watch begins anew.
  void restart(const World& world);
  /// After each step. @returns how many bodies are frozen now
  /// @param cut  whether the step cut the motion of any body short
  int after(const World& world, const Pose& device, bool tool_touches, bool cut);

 private:
  struct Watched {  // a body
    VecX before;    // its nodes after the last step
    int still = 0;  // steps in a row
    int stopped = 0;
  };
  bool pulled(const World& world, const Pose& device) const;
  bool pullChanged(const World& world, const Pose& device) const;

  double step_;
  int steps_;     // of 0.3 s
  Vec6 hanging_;  // handle against device at the start
  std::vector<Watched> watched_;
  std::deque<Pose> devices_;  // of the last steps_ steps
};

}  // namespace palpate
