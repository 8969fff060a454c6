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

// Force and handle at the end of finer steps than those that the derivatives are of.
void endWith(const Vec6& force, const World& world, HandleModel& model) {
  model.force = force;
  model.handle_pose = world.tool().state.handle.pose;
  model.handle_twist = world.tool().state.handle.twist;
}

// The derivatives first, from a step as long as their horizon that is then not taken; force and motion from finer ones.
void stepInParts(World& world, const DeviceTarget& target, const VisualStepSettings& settings,
                 const HandleModel& previous, VisualRecord& record) {
  record.step = world.evaluate(target, settings.step);
  record.model = modelOf(world, settings, record, previous);
  const StepReport horizon = record.step;
  record.step = world.step(target, settings.step, settings.substeps);
  record.step.status = std::max(record.step.status, horizon.status);
  record.step.times += horizon.times;
  if (record.step.failed()) {
    record.model = previous;
    return;
  }
  endWith(couplingWrench(world), world, record.model);
}

// After a step that was done again in shorter ones: theirs are force and motion. The derivatives are those of a whole
// step from where they ended, as those of a short one are not of this horizon; if it fails or there is no time for it,
// those of the step before.
HandleModel modelAfterRedoing(World& world, const DeviceTarget& target, const VisualStepSettings& settings,
                              const HandleModel& previous, VisualRecord& record) {
  const Vec6 force = couplingWrench(world);
  HandleModel model = previous;
  if (!record.step.out_of_budget) {
    VisualRecord whole;
    whole.time = record.time;
    whole.step = world.evaluate(target, settings.step);
    record.step.times += whole.step.times;
    if (whole.step.status == StepStatus::ok) model = modelOf(world, settings, whole, previous);
    record.linearization_s = whole.linearization_s;
  }
  endWith(force, world, model);
  model.pose = model.handle_pose;
  model.twist = model.handle_twist;
  model.time = record.time;
  return model;
}

VisualRecord stepOf(World& world, const DeviceTarget& target, const VisualStepSettings& settings, double time,
                    const HandleModel& previous) {
  VisualRecord record;
  record.time = time;
  if (settings.substeps > 1) {
    stepInParts(world, target, settings, previous, record);
    return record;
  }
  record.step = world.step(target, settings.step);  // 1: constrained dynamics, eq. (2)
  record.model = record.step.redone > 0 ? modelAfterRedoing(world, target, settings, previous, record)
                                        : modelOf(world, settings, record, previous);  // 2 to 6: eq. (6) to (11)
  return record;
}

}  // namespace

VisualRecord visualStep(World& world, const DeviceTarget& target, const VisualStepSettings& settings, double time,
                        const HandleModel& previous) {
  VisualRecord record = stepOf(world, target, settings, time, previous);
  record.model.unsound = !record.step.sound();
  return record;
}

}  // namespace palpate
