#include "palpate/simulation/motion_bend.h"

#include <algorithm>

#include "palpate/math/largest_norm.h"

namespace palpate {
namespace {

// Of the free nodes; of a held body against its handle, in the handle's frame.
VecX speedsOf(const BodyModel& model, const BodyState& state) {
  if (model.isRigid()) return {};
  if (model.held()) return model.speedsInHandle(state, model.placesInHandle(state));
  VecX out(3 * model.freeNodes());
  for (int r = 0; r < model.freeNodes(); ++r) {
    out.segment<3>(3 * r) = state.velocities.segment<3>(3 * model.free()[r]);
  }
  return out;
}

}  // namespace

void MotionBend::begin(const Models& models, const std::vector<BodyState>& states, const ToolPath& path) {
  speeds_.resize(models.size());
  for (std::size_t i = 0; i < models.size(); ++i) {
    VecX& speeds = speeds_[i];
    speeds = speedsOf(*models[i], states[i]);
    const auto add = [&](const VecX& more) {
      if (more.size() == speeds.size()) speeds += more;
    };
    if (models[i]->held()) {
      add(path.velocity);
    } else if (const BodyCorrection* other = correctionOf(path.others, static_cast<int>(i))) {
      add(other->velocity);
    }
  }
}

double MotionBend::end(const Models& models, const std::vector<BodyState>& states) const {
  double most = 0;
  for (std::size_t i = 0; i < models.size(); ++i) {
    const VecX speeds = speedsOf(*models[i], states[i]);
    if (speeds.size() > 0) most = std::max(most, largestNorm(VecX(speeds - speeds_[i])));
  }
  return most;
}

}  // namespace palpate
