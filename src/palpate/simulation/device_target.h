#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "palpate/math/rotation.h"
#include "palpate/math/types.h"
#include "palpate/rigid/handle.h"

namespace palpate {

/// What the visual handle is pulled towards during a step: the device's sample, or where it is predicted to be.
struct DeviceTarget {
  Pose pose;
  Vec6 twist = Vec6::Zero();
};

/// @param share  of the way from one to the other, in [0, 1]
inline DeviceTarget between(const DeviceTarget& from, const DeviceTarget& to, double share) {
  const Vec6 way = poseDifference(to.pose, from.pose);
  return {advance(from.pose, share * way), (1.0 - share) * from.twist + share * to.twist};
}

/// Of a body that nothing leads: a displacement of the free nodes that the next step makes besides, and what is added
/// to their velocities at its start; world frame, 3 a free node. Of a rigid body as a twist, 6. [m; rad], [m/s; rad/s]
struct BodyCorrection {
  int body = -1;
  VecX shift, velocity;
};

/// That of a body, or null.
inline const BodyCorrection* correctionOf(const std::vector<BodyCorrection>& corrections, int body) {
  const auto at = std::find_if(corrections.begin(), corrections.end(), [&](const auto& c) { return c.body == body; });
  return at == corrections.end() ? nullptr : &*at;
}

/// What the tool's handle does during a step instead of being pulled: it follows recorded states.
struct ToolPath {
  std::vector<HandleState> points;  ///< at equal intervals, the first at the start of the step, the last at its end
  /// Corrections of the tool's free nodes, handle's frame, 3 a free node, or empty: a displacement that the step makes
  /// besides, and what is added to the velocities at its start. [m], [m/s]
  VecX shift, velocity;
  std::vector<BodyCorrection> others{};  ///< the same of other bodies
  Vec6 link = Vec6::Zero();              ///< of the link on the handle, at the end [N; N m]
  /// A tool that resists with more than this is not led through [N].
  double largest_force = std::numeric_limits<double>::infinity();
  /// Where nodes would leave straight lines by more than this in a step, by what they did in the last one, it is taken
  /// in parts from the start (docs/step.md, "What bends") [m].
  double largest_bend = std::numeric_limits<double>::infinity();

  /// @param share  of the step, in [0, 1]
  HandleState at(double share) const {
    const double place = share * static_cast<double>(points.size() - 1);
    const std::size_t k = std::min(static_cast<std::size_t>(place), points.size() - 1);
    const double rest = place - static_cast<double>(k);
    if (k + 1 == points.size() || rest < 1e-9) return points[k];
    const DeviceTarget here{points[k].pose, points[k].twist}, next{points[k + 1].pose, points[k + 1].twist};
    const DeviceTarget found = between(here, next, rest);
    return {found.pose, found.twist};
  }
};

}  // namespace palpate
