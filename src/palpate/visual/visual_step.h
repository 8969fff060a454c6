#pragma once

#include "palpate/linearization/handle_model.h"
#include "palpate/linearization/linearize.h"
#include "palpate/reduction/reduction_times.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// What a visual step is taken with, besides the device.
struct VisualStepSettings {
  LinearizationSettings linearization;
  double step = 0.033;  ///< h [s]
  /// Equal parts in which the step is taken. The derivatives are still those of one step of length h, their horizon;
  /// force and motion are those of the finer steps. That costs one step more.
  int substeps = 1;
};

/// One visual step of a run.
struct VisualRecord {
  double time = 0;  ///< at which the step began [s]
  HandleModel model;
  StepReport step;
  double linearization_s = 0;  ///< wall-clock time of linearize()
  double lateness_s = 0;       ///< real time: how much later than its turn the step began
  ReductionTimes reduction{};  ///< method live: parts of linearization_s
};

/// One visual step and its handle model: the six steps of the paper's algorithm (section 3.4). Lockstep, real time,
/// viewer and studies all call this one. What is to be done about a step (do it again shorter, bound its time, look at
/// it) belongs to the caller.
/// @param target    what the visual handle is pulled towards
/// @param time      at which the step begins [s]
/// @param previous  model of the step before, which stays in force if this step fails; its age then tells the watchdog
VisualRecord visualStep(World& world, const DeviceTarget& target, const VisualStepSettings& settings, double time,
                        const HandleModel& previous);

}  // namespace palpate
