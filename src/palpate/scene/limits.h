#pragma once

#include "palpate/scene/value.h"

namespace palpate::limits {

// Bounds that scene files and the command line share; docs/scene.md lists them.

inline constexpr int kTetrahedra = 200000;  ///< of a whole scene
inline constexpr int kMinTetrahedra = 10;   ///< wanted for an embedded surface
/// Of all rigid bodies and obstacles: contact takes about 250 bytes each.
inline constexpr int kFixedTriangles = 10'000'000;
inline constexpr int kLatency = 100;   ///< visual steps
inline constexpr double kTicks = 1e7;  ///< haptic ticks in a run

inline const Range kDuration = Range::positive(3600.0, "s");
inline const Range kVisualStep = Range::positive(1.0, "s");
inline const Range kHapticStep = Range::within(1e-5, 0.1, "s");

}  // namespace palpate::limits
