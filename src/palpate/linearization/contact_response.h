#pragma once

#include <vector>

#include "palpate/friction/contact_solver.h"
#include "palpate/math/types.h"
#include "palpate/simulation/contact_set.h"

namespace palpate {

/// Linear contact law of the active contacts at the solution: dlambda = B y, (C^T W B + D) y = C^T (given - change of
/// the free velocity). Each unknown belongs to one contact; its columns of B and C are zero in the rows of all others.
/// stick: all three rows free; vertex and edge of the linearized cone, slide on the exact one: see
/// docs/linearization.md.
struct ContactResponse {
  std::vector<int> contact;  ///< of each unknown, as a place in the list
  Eigen::Matrix3Xd b;        ///< 3 x unknowns
  Eigen::Matrix3Xd c;        ///< 3 x unknowns
  VecX d;                    ///< unknowns; turning of the friction direction on the exact cone
};
/// @param list  contacts of the set; rows are theirs
/// @param used  one a contact of the list: those that are not are left out as if they were open
/// @param row_velocity  w = W lambda + free of the list's rows [m/s]
ContactResponse contactResponse(const ContactSet& set, const std::vector<int>& list, const std::vector<char>& used,
                                const FrictionCone& cone, const VecX& row_velocity);

}  // namespace palpate
