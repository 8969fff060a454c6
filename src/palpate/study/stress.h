#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "palpate/scene/builder.h"
#include "palpate/session/run_timing.h"
#include "palpate/study/stress_hand.h"

namespace palpate {

/// A random hand on a scene's visual steps, taken as `run` takes them.
struct StressSettings {
  RunTiming timing;
  StressMotion motion;  ///< its step and reach follow from timing and scene
  std::uint64_t seed = 1;
  int steps = 1000;            ///< visual steps in all, calm ones included; rides are ridden to their ends
  int rides = 0;               ///< 0: as many as the steps need
  bool riding = false;         ///< rides, each from the built scene, with seeds that count up; else one wild hand
  bool by_clock = false;       ///< steps end early by the clock, as in real time: no two runs are the same then
  bool solve_static = false;   ///< after a ride whose tool touches something: settle it, and compare
  double reach = 0.75;         ///< farthest that the device goes from its start, in diagonals of the tool
  std::vector<int> crossable;  ///< bodies whose surfaces may pass through themselves
};

/// What happened in some steps.
struct StressTally {
  int steps = 0;
  int nan = 0;  ///< steps after which a position or velocity was not finite
  double deepest_penetration_rel =
      0;                  ///< after any step, of any surface point in another solid, by the tool's diagonal
  double max_energy = 0;  ///< kinetic and elastic [J]
  double max_kinetic = 0, max_elastic = 0;  ///< each by itself [J]
  int restored = 0;                         ///< steps that failed and left the state as it was
  int not_converged = 0;                    ///< steps whose contact solution did not reach its tolerance
  int cut = 0;                              ///< steps in which a body was stopped on its way, lest it cross another
  int cut_twice = 0;                        ///< cut steps that follow a cut one
  double least_share = 1;                   ///< of its motion that a body made
  int redone = 0;                           ///< steps that were done again in shorter ones
  double energy_made = 0, largest_energy_made = 0;  ///< StepReport::energy_made: sum, largest of a step [J]
  int frozen = 0;                                   ///< steps after which a body was frozen (FreezeWatch)
  int crossed = 0;                                  ///< steps after which a body intersected itself
  int passed = 0;  ///< those of them in which parts did that are not neighbors in the mesh
  int folded = 0;  ///< steps after which a body had inverted tetrahedra

  // after calm: at its end; of rides, the largest numbers in the last second
  int wrong_side = 0;          ///< surface vertices inside another solid
  int self_intersections = 0;  ///< pairs of triangles
  int inverted = 0;            ///< tetrahedra
  int restless = 0;            ///< steps in a ride's last second that were cut or did not converge

  /// Sums and worst of both.
  StressTally& operator+=(const StressTally& other);
};

/// What a ride's end is compared with.
enum class RideJudge {
  none,       ///< the tool touches something, and nobody asked for a static solution, or there was none
  reference,  ///< the built scene, left alone for as long as the ride's hand stood still, or for all of the ride where
              ///< the world drives the tool
  settled,    ///< the static solution from the ride's end
  swings  ///< the reference, in all but its energy: the tool touches nothing, and the static solutions from the ride's
          ///< end and of the built scene agree. What damps it little swings for longer than a ride's calm
};

struct StressRide {
  std::uint64_t seed = 0;
  StressTally tally;
  RideJudge judge = RideJudge::none;
  double handle_off = 0;  ///< of the handle, from where the judge (else the reference) has it [m]
  double energy = 0;      ///< elastic, of the tool, at the end [J]
  double energy_off = 0;  ///< by which it differs from the judge's (else the reference's) [J]
  bool came_back = true;  ///< as far as it was judged
  double max_ms = 0;      ///< longest step
  bool failed() const;
};

struct StressOutcome {
  StressTally all;
  std::vector<StressRide> rides;
  double median_ms = 0, p99_ms = 0, p99_9_ms = 0, max_ms = 0;  ///< of a step
  bool stopped = false;                                        ///< before its end
};

/// @param going_on  takes the share done; false: enough, with what there is. A ride cut short is not judged at its end.
StressOutcome runStress(BuiltScene& scene, const StressSettings& settings,
                        const std::function<bool(double)>& going_on = {});

/// One line for each criterion that the run fails; docs/contact.md names them.
std::vector<std::string> stressFailures(const StressOutcome& outcome);

}  // namespace palpate
