#pragma once

#include <vector>

#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// How stiff a mesh of a surface is as a whole: its lower end is held, its upper end pulled.
struct MeshStiffness {
  EmbedReport embed;
  Vec3 stiffness = Vec3::Zero();  ///< force by mean displacement of the pulled end, along x, y, z [N/m]
};

/// Linear elasticity at rest, Young's modulus 1 kPa, Poisson's ratio 0.4. Held and pulled are the surface's parts in
/// the outer tenths along its longest side, held by springs 1,000 times as stiff as the solid and pulled by uniform
/// traction, both through the embedding, so that meshes of any size have the same task. Coarse linear tetrahedra are
/// too stiff, above all in bending: compare counts.
/// @throws InputError as embedSurface() does
MeshStiffness meshStiffness(const Surface& surface, const EmbedOptions& options);

}  // namespace palpate
