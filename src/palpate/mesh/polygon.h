#pragma once

#include <array>
#include <span>
#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// Looks at corners that the polygons of one file may cost; one of 10,000 corners takes some 1e7 of them.
inline constexpr long long kPolygonLooks = 300'000'000;

/// Cuts a polygon of n corners into n - 2 triangles that run around like it. Seen along its area's normal, it may be
/// concave, touch itself (a hole that a bridge joins to the rim), have corners in a line or come by a corner twice. The
/// fan from the first corner, where none of its triangles lies the wrong way round; otherwise ears are cut. A polygon
/// that has no area, or crosses itself so that it runs out of ears, gets the fan.
/// @param corners  indices into vertices, all in range
/// @param looks    how many looks at corners are left; where they run out, the fan
/// @param out      n - 2 triangles
void cutPolygon(const std::vector<Vec3>& vertices, std::span<const int> corners, long long& looks,
                std::array<int, 3>* out);

}  // namespace palpate
