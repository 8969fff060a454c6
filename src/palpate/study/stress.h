#pragma once

#include <cstdint>
#include <functional>

#include "palpate/scene/builder.h"

namespace palpate {

/// Violent device motion on a scene's visual step: bursts of random speeds, reversals and teleports, each followed by
/// half a second in which the device stands still.
struct StressSettings {
  int steps = 1000;  ///< visual steps in all, calm ones included
  std::uint64_t seed = 1;
  double step = 0.033;      ///< h [s]
  double speed = 2.0;       ///< of the device [m/s]
  double spin = 10.0;       ///< [rad/s]
  double burst = 1.0;       ///< [s]
  double calm = 0.5;        ///< [s]
  double reach = 0.75;      ///< farthest that the device goes from its start, in diagonals of the tool
  double max_force = 3.3;   ///< at which the link saturates [N]
  double max_torque = 0.1;  ///< [N m]
};

struct StressOutcome {
  int steps = 0;
  double deepest_penetration_rel =
      0;                  ///< after any step, of any surface point in another solid, by the tool's diagonal
  int nan = 0;            ///< steps after which a position or velocity was not finite
  int wrong_side = 0;     ///< surface vertices inside another solid at the ends of calm
  double max_energy = 0;  ///< kinetic and elastic [J]
  double max_kinetic = 0, max_elastic = 0;  ///< each by itself [J]
  int restored = 0;                         ///< steps that failed and left the state as it was
  int not_converged = 0;                    ///< steps whose contact solution did not reach its tolerance
  int cut = 0;                              ///< steps in which a body was stopped on its way, lest it cross another
  double median_ms = 0, p99_ms = 0, max_ms = 0;  ///< of a step
};

/// Penetration is examined apart from the step's own contacts, from the surfaces alone.
StressOutcome runStress(BuiltScene& scene, const StressSettings& settings,
                        const std::function<void(double)>& progress = {});

}  // namespace palpate
