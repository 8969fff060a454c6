#pragma once

#include <vector>

#include "palpate/linearization/handle_model.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// What stands for A_lambda = J A^-1 J^T in eq. (11).
enum class DelassusModel {
  diagonal,  ///< `hsl`: its diagonal on a well-conditioned subset of the tool's active contacts; as in the paper, other
             ///< bodies are left out: only the tool gives way
  exact,     ///< `hsl-exact`: the whole matrix, of all bodies that the tool touches and that these touch
};

/// How much of the step is differentiated.
enum class Derivative {
  frozen,  ///< stiffness, element rotations, and G and M_h inside A held; the lever arms of the explicit forces turn
  full,    ///< everything live but the contact frames: also element rotations of tetrahedra that touch attached nodes,
           ///< G(R) and R I R^T inside A, the link's Jacobian, the lever arms of contact on the handle
};

struct LinearizationSettings {
  DelassusModel delassus = DelassusModel::diagonal;
  Derivative derivative = Derivative::frozen;
};

/// Coupling wrench on the handle at the end of the last step: from the tool's free nodes, and contact on the handle's
/// part of the surface [N; N m], about the handle's origin.
///   Fc = G^T [f_H - (h K_HH + D_HH) G u - (h K_HT + D_HT) v_t] + J_h^T lambda / h,   D = beta K
Vec6 couplingWrench(const World& world);

/// Steps 2 to 6 of the paper's algorithm (section 3.4), from the step just taken or evaluated.
/// Needs a tool. Kx and Kv are the derivatives by the handle's pose and twist at the start of the step, with the active
/// contacts, their states and their frames held. No mesh-sized solve for the frozen derivative: with D proportional to
/// K off the diagonal, the columns of b_t lie in the span of A_th, whose response X the step has already.
/// @param time  at which the step began [s]
HandleModel linearize(World& world, const LinearizationSettings& settings, double time);

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
