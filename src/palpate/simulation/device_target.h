#pragma once

#include "palpate/math/rotation.h"
#include "palpate/math/types.h"

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

}  // namespace palpate
