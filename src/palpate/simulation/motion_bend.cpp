#include "palpate/simulation/motion_bend.h"

#include <algorithm>

#include "palpate/math/largest_norm.h"

namespace palpate {
namespace {

// Of the free nodes; of a held body against its handle, in the handle's frame.
void speedsOf(const BodyModel& model, const BodyState& state, VecX& out) {
  out.resize(model.isRigid() ? 0 : 3 * model.freeNodes());
  if (out.size() == 0) return;
  const Pose& pose = state.handle.pose;
  const Mat3 rt = pose.matrix().transpose();
  for (int r = 0; r < model.freeNodes(); ++r) {
    const int i = model.free()[r];
    Vec3 v = state.velocities.segment<3>(3 * i);
    if (model.held()) {
      const Vec3 arm = state.positions.segment<3>(3 * i) - pose.position;
      v = rt * (v - state.handle.twist.head<3>() - state.handle.twist.tail<3>().cross(arm));
    }
    out.segment<3>(3 * r) = v;
  }
}

}  // namespace

void MotionBend::begin(const Models& models, const std::vector<BodyState>& states, const ToolPath& path) {
  speeds_.resize(models.size());
  for (std::size_t i = 0; i < models.size(); ++i) {
    VecX& speeds = speeds_[i];
    speedsOf(*models[i], states[i], speeds);
    const BodyCorrection* other = correctionOf(path.others, static_cast<int>(i));
    const VecX none, &more = models[i]->held() ? path.velocity : other != nullptr ? other->velocity : none;
    if (more.size() == speeds.size()) speeds += more;
  }
}

double MotionBend::end(const Models& models, const std::vector<BodyState>& states) const {
  double most = 0;
  VecX speeds;
  for (std::size_t i = 0; i < models.size(); ++i) {
    speedsOf(*models[i], states[i], speeds);
    if (speeds.size() > 0) most = std::max(most, largestNorm(VecX(speeds - speeds_[i])));
  }
  return most;
}

}  // namespace palpate
