#pragma once

#include <array>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/pair_front.h"
#include "palpate/contact/self_exclusion.h"

namespace palpate {

/// Pairs of triangles of one surface, the lower index first, that share no vertex and intersect: an edge of one passes
/// through the other. At the start positions, after refit(); appends. Triangles that merely touch or lie in one plane
/// do not count.
/// @param exclusion  of this surface: pairs that it excludes are left out; null: none are
/// @param front      of searches within the surface with that exclusion, which know what cannot touch; null: none
/// @param moved      how far vertices have moved relative to each other since the last of them [m]
void findSelfIntersections(const CollisionSurface& surface, std::vector<std::array<int, 2>>& out,
                           const SelfExclusion* exclusion = nullptr, const PairFront* front = nullptr,
                           double moved = 0);

}  // namespace palpate
