#pragma once

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
///   Fc = G^T [f_H - (h K_HH + D_HH) G u - (h K_HT + D_HT) v_t] + J_h^T lambda / h,   D = beta K        paper, eq. (6)
Vec6 couplingWrench(const World& world);

/// Steps 2 to 6 of the paper's algorithm (section 3.4), from the step just taken or evaluated.
/// Needs a tool. Kx and Kv are the derivatives by the handle's pose and twist at the start of the step, with the active
/// contacts, their states and their frames held. No mesh-sized solve for the frozen derivative.
/// @param time  at which the step began [s]
HandleModel linearize(const World& world, const LinearizationSettings& settings, double time);

}  // namespace palpate
