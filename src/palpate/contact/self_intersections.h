#pragma once

#include <array>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/self_exclusion.h"

namespace palpate {

/// Pairs of triangles of one surface, the lower index first, that share no vertex and intersect: an edge of one passes
/// through the other. At the start positions, after refit(); appends. Triangles that merely touch or lie in one plane
/// do not count.
/// @param exclusion  of this surface: pairs that it excludes are left out; null: none are
void findSelfIntersections(const CollisionSurface& surface, std::vector<std::array<int, 2>>& out,
                           const SelfExclusion* exclusion = nullptr);

}  // namespace palpate
