#pragma once

#include <memory>
#include <vector>

#include "palpate/simulation/body_model.h"
#include "palpate/simulation/body_state.h"
#include "palpate/simulation/device_target.h"

namespace palpate {

/// By how much a step changes velocities of soft bodies' free nodes: those of a held body against its handle, as one
/// rigid body with it. One linearization a step sees of a motion what goes straight on (docs/step.md, "What bends").
class MotionBend {
 public:
  using Models = std::vector<std::unique_ptr<BodyModel>>;
  /// @param states  at the start of a step
  /// @param path    whose corrections it brings: what they change is no bend
  void begin(const Models& models, const std::vector<BodyState>& states, const ToolPath& path);
  /// @param states  at its end
  /// @returns the largest change of a node's velocity [m/s]
  double end(const Models& models, const std::vector<BodyState>& states) const;

 private:
  std::vector<VecX> speeds_;  // of each body's free nodes; none of rigid ones
};

}  // namespace palpate
