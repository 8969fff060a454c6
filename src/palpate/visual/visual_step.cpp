#include "palpate/visual/visual_step.h"

#include <algorithm>

#include "palpate/common/scoped_timer.h"

namespace palpate {
namespace {

/// Steps 2 to 6 (linearization/linearize.h): active constraints, derivatives of the right-hand sides, of the velocities
/// and of the coupling force, the linear model. A failed step leaves the model of the one before.
HandleModel modelOf(const World& world, const VisualStepSettings& settings, VisualRecord& record,
                    const HandleModel& previous) {
  const ScopedTimer timer(record.linearization_s);
  return record.step.failed() ? previous : linearize(world, settings.linearization, record.time);
}

// The substeps' report: the last one's, with the worst of all and the times of all.
StepReport stepFinely(World& world, const DeviceTarget& target, double h, int substeps) {
  StepReport sum;
  for (int k = 0; k < substeps; ++k) {
    StepReport r = world.step(target, h);
    r.penetration = std::max(r.penetration, sum.penetration);
    r.solver_residual = std::max(r.solver_residual, sum.solver_residual);
    r.motion_share = std::min(r.motion_share, sum.motion_share);
    r.solver_iterations += sum.solver_iterations;
    r.passes = std::max(r.passes, sum.passes);
    r.status = std::max(r.status, sum.status);
    r.redone += sum.redone;
    r.energy_made += sum.energy_made;
    r.times += sum.times;
    sum = r;
  }
  return sum;
}

// The derivatives first, from a step as long as their horizon that is then not taken; force and motion from finer ones.
void stepInParts(World& world, const DeviceTarget& target, const VisualStepSettings& settings,
                 const HandleModel& previous, VisualRecord& record) {
  record.step = world.evaluate(target, settings.step);
  record.model = modelOf(world, settings, record, previous);
  const StepReport horizon = record.step;
  record.step = stepFinely(world, target, settings.step / settings.substeps, settings.substeps);
  record.step.status = std::max(record.step.status, horizon.status);
  record.step.times += horizon.times;
  if (record.step.failed()) {
    record.model = previous;
    return;
  }
  record.model.force = couplingWrench(world);
  record.model.handle_pose = world.tool().state.handle.pose;
  record.model.handle_twist = world.tool().state.handle.twist;
}

}  // namespace

VisualRecord visualStep(World& world, const DeviceTarget& target, const VisualStepSettings& settings, double time,
                        const HandleModel& previous) {
  VisualRecord record;
  record.time = time;
  if (settings.substeps > 1) {
    stepInParts(world, target, settings, previous, record);
    return record;
  }
  record.step = world.step(target, settings.step);            // 1: constrained dynamics, eq. (2)
  record.model = modelOf(world, settings, record, previous);  // 2 to 6: eq. (6) to (11)
  return record;
}

}  // namespace palpate
