#include "palpate/simulation/step_energy.h"

#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

// Of the free nodes.
struct Weight {
  Vec3 way = Vec3::Zero();  // mass times displacement [kg m]
  Vec3 arm = Vec3::Zero();  // mass times place at the end, about the handle's origin [kg m]
  double mass = 0;
};

// @param led  beyond what they move with the handle, as one rigid body
Weight weightOf(const BodySystem& system, const BodyState& end, bool led) {
  const BodyModel& model = system.model();
  const VecX& start = system.startPositions();
  const Pose &before = system.startPose(), &now = end.handle.pose;
  const Mat3 turn = now.matrix() * before.matrix().transpose();
  Weight out;
  for (int i = 0; i < model.nodes(); ++i) {
    if (model.attachedIndex()[i] >= 0) continue;
    const double m = model.elasticity().mass()[i];
    const Vec3 x = end.positions.segment<3>(3 * i), x0 = start.segment<3>(3 * i);
    out.way += m * (x - (led ? Vec3(now.position + turn * (x0 - before.position)) : x0));
    if (!led) continue;
    out.arm += m * (x - now.position);
    out.mass += m;
  }
  return out;
}

}  // namespace

StepWork workOn(const BodySystem& system, const BodyState& end) {
  const BodyModel& model = system.model();
  const StepInput& input = system.input();
  StepWork work;
  // who leads a handle carries its weight and the tool's: what gravity does on the way that they go as one, he undoes
  const bool led = model.held() && input.followed.on;
  const Weight weight = weightOf(system, end, led);
  if (model.driven()) work.add(system.attachmentWork());
  Vec3 way = weight.way;
  if (model.framed() && !led) {
    way += model.handle().mass * (end.handle.pose.position - system.startPose().position);
  }
  work.add(input.gravity.dot(way));
  if (led) {
    // he gives it what it has more, and what the tool resists but for its weight
    const Vec6 motion = poseDifference(end.handle.pose, system.startPose());
    const auto kinetic = [&](const HandleState& h) {
      return 0.5 * h.twist.dot(model.handle().massMatrix(h.pose) * h.twist);
    };
    work.add(kinetic(end.handle) - kinetic({system.startPose(), system.startTwist()}));
    Vec6 wrench = system.wrenchOnHandle(end);
    wrench.head<3>() -= weight.mass * input.gravity;
    wrench.tail<3>() -= weight.arm.cross(input.gravity);
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
