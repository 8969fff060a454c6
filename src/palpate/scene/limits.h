#pragma once

#include "palpate/scene/value.h"

namespace palpate::limits {

// Bounds that scene files and the command line share; docs/scene.md lists them.

inline constexpr int tetrahedra = 200000;  ///< of a whole scene
inline constexpr int min_tetrahedra = 10;  ///< wanted for an embedded surface
inline constexpr int latency = 100;        ///< visual steps
inline constexpr double ticks = 1e7;       ///< haptic ticks in a run

inline const Range duration = Range::positive(3600.0, "s");
inline const Range visual_step = Range::positive(1.0, "s");
inline const Range haptic_step = Range::within(1e-5, 0.1, "s");

}  // namespace palpate::limits
