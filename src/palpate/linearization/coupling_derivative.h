#pragma once

#include "palpate/simulation/world.h"

namespace palpate {

/// End-of-step nodal forces e = f - (h + beta) K v of the tetrahedra that join handle and free nodes, and their
/// derivative by the handle's pose. The residual of the step holds -h e on the free nodes and -h G^T e on the handle,
/// and Fc = G^T e: so these are all that the derivatives need.
struct CouplingForces {
  Vec6 wrench = Vec6::Zero();       ///< G^T e
  Mat6 lever_start = Mat6::Zero();  ///< torque by rotation, lever arms turning under the forces at the start: Geo(f_H)
  Mat6 lever_end = Mat6::Zero();    ///< the same under the forces at the end of the step: Geo(e_H)
};
CouplingForces couplingForces(const Body& tool);

/// What the full derivative adds to the frozen one at fixed u and v_t, columns by pose.
struct RotationTerms {
  MatX free;                   ///< d e_t, 3 free x 6
  Mat6 handle = Mat6::Zero();  ///< d (G^T e_H) beyond -G^T K_HH G and the lever arms
};
RotationTerms rotationTerms(const Body& tool);

}  // namespace palpate
