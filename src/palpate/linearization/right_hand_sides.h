#pragma once

#include "palpate/linearization/active_contacts.h"
#include "palpate/linearization/coupling_derivative.h"
#include "palpate/linearization/linearize.h"

namespace palpate {

using Mat612 = Eigen::Matrix<double, 6, 12>;  ///< columns: six by the handle's pose, six by its twist

/// The paper's step 3: derivatives of the right-hand sides (b, b_lambda) by the handle's pose and twist at the start of
/// the step; b is -r, the step's residual at fixed u, v_t, lambda. With D proportional to K off the diagonal, the
/// tool's frozen part is -h K_TH G = -A_th h / c: its response -X h / c the step has already.
struct RightHandSides {
  Mat612 handle = Mat612::Zero();  ///< db_h
  Mat612 tool = Mat612::Zero();    ///< X^T db_t
  Mat6 force = Mat6::Zero();       ///< dFc/dpose at fixed u, v_t: goes into eq. (8) as it is
  MatX free_rows;                  ///< J_t A_tt^-1 db_t by pose, of the active contacts' list: rows x 6
  MatX given;                      ///< db_lambda: rows x 12
};
RightHandSides differentiateRightHandSides(const World& world, const ActiveContacts& active,
                                           const CouplingForces& forces, const LinearizationSettings& settings);

}  // namespace palpate
