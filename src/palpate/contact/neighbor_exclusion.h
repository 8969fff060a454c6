#pragma once

#include <vector>

#include "palpate/contact/self_exclusion.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// What of a soft body's surface moves almost together and so does not touch: surface in the same tetrahedron, or in
/// two that share a node.
/// @param tetrahedron  of each vertex of the surface
SelfExclusion excludeNeighbors(const CollisionSurface& surface, const std::vector<int>& tetrahedron,
                               const TetrahedralMesh& mesh);

}  // namespace palpate
