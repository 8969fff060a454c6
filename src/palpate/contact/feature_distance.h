#pragma once

#include <array>

#include "palpate/math/segment.h"
#include "palpate/math/triangle.h"
#include "palpate/math/types.h"

namespace palpate {

/// Closest points of two segments: (1 - s) a0 + s a1 and (1 - t) b0 + t b1.
struct SegmentPair {
  double s = 0;
  double t = 0;
  double distance = 0;  ///< [m]
};

/// Closest points of two segments. Parallel segments give a pair with an end point, one of many that are as near.
SegmentPair closestOnSegments(const Vec3& a0, const Vec3& a1, const Vec3& b0, const Vec3& b1);

/// What four points mean: a vertex, then the corners of a face; or the ends of one edge, then those of another.
enum class FeatureKind { vertex_face, edge_edge };

struct Approach {
  double time = 1;       ///< in [0, 1]: the distance exceeds the minimum all along [0, time]
  bool reached = false;  ///< the features come down to the minimum distance soon after `time`
};

/// When two features whose points move along straight lines come near each other. Conservative: never too late, and
/// where the iterations run out, `time` is what has been proven so far and `reached` is set. `reached` is exact to a
/// tenth of min_distance.
/// Each iteration takes the plane across the present shortest line and goes on until a point of one feature could meet
/// a point of the other along its normal; that is never less than the step of additive continuous detection (Li,
/// Kaufman, Jiang 2021, "Codimensional incremental potential contact"), which divides by the largest speed.
/// @param start, end    the four points at time 0 and 1 [m]
/// @param min_distance  below the distance at the start; else the result is {0, true} [m]
/// @param until         what comes later than this does not matter, and is not reached
Approach timeOfApproach(FeatureKind kind, const std::array<Vec3, 4>& start, const std::array<Vec3, 4>& end,
                        double min_distance, int max_iterations = 64, double until = 1);

}  // namespace palpate
