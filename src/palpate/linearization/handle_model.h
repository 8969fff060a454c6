#pragma once

#include "palpate/math/types.h"

namespace palpate {

/// All that the haptic loop gets from the visual loop; its size depends on neither mesh nor contacts.
/// F*(x, u) = force + kx (x - x0) + kv (u - u0), x - x0 = (p - p0, log(R R0^T))      paper, eq. (7)
struct HandleModel {
  Vec6 force = Vec6::Zero();  ///< coupling wrench of the tool on the handle [N; N m], about the handle's origin, world
  Pose pose;                  ///< x0: handle at the start of the visual step
  Vec6 twist = Vec6::Zero();  ///< u0 [m/s; rad/s]
  Mat6 kx = Mat6::Zero();     ///< dF/dx [N/m, N/rad; N, N m/rad]; not symmetric under sliding friction
  Mat6 kv = Mat6::Zero();     ///< dF/du [N s/m, ...]
  Pose handle_pose;           ///< visual handle at the end of the step: what virtual coupling pulls the device towards
  Vec6 handle_twist = Vec6::Zero();
  double time = 0.0;     ///< time at which the step began, i.e. of x0 and u0 [s]
  double step = 0.0;     ///< length of the visual step [s]
  bool unsound = false;  ///< the step failed, was cut or ended early, or its contact was not solved
};

}  // namespace palpate
