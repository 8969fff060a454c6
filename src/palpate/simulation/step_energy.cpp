#include "palpate/simulation/step_energy.h"

#include <algorithm>
#include <cmath>

namespace palpate {

StepWork workOn(const BodySystem& system, const BodyState& end) {
  const BodyModel& model = system.model();
  const StepInput& input = system.input();
  const VecX& start = system.startPositions();
  StepWork work;
  Vec3 moment = Vec3::Zero();  // mass times displacement
  for (int i = 0; i < model.nodes(); ++i) {
    if (model.attachedIndex()[i] >= 0) continue;
    moment += model.elasticity().mass()[i] * (end.positions.segment<3>(3 * i) - start.segment<3>(3 * i));
  }
  if (model.driven()) work.add(system.attachmentWork());
  // who leads a handle carries its weight as well: what gravity does on it, he undoes
  const bool led = model.held() && input.followed.on;
  if (model.framed() && !led) {
    moment += model.handle().mass * (end.handle.pose.position - system.startPose().position);
  }
  work.add(input.gravity.dot(moment));
  if (led) {
    // he gives it what it has more, and what the tool resists
    const Vec6 motion = poseDifference(end.handle.pose, system.startPose());
    const auto kinetic = [&](const HandleState& h) {
      return 0.5 * h.twist.dot(model.handle().massMatrix(h.pose) * h.twist);
    };
    work.add(kinetic(end.handle) - kinetic({system.startPose(), system.startTwist()}));
    const Vec6 wrench = system.wrenchOnHandle(end);
    work.add(-wrench.head<3>().dot(motion.head<3>()));
    work.add(-wrench.tail<3>().dot(motion.tail<3>()));
  } else if (model.held()) {
    const Vec6 on_device =
        linkWrenchOnDevice(input.link, end.handle.pose, end.handle.twist, input.device.pose, input.device.twist);
    const Vec6 motion = poseDifference(end.handle.pose, system.startPose());
    work.add(-on_device.head<3>().dot(motion.head<3>()));
    work.add(-on_device.tail<3>().dot(motion.tail<3>()));
  }
  return work;
}

double energyMade(double start, double end, const StepWork& work, double share) {
  constexpr double kRounding = 1e-9;  // of the energies; and [J]
  const double made = end - start - work.sum - 0.01 * (share * start + work.magnitudes);
  return made > kRounding * (start + end + 1.0) ? made : 0.0;
}

}  // namespace palpate
