#pragma once

#include "palpate/mesh/types.h"

namespace palpate {

/// The same shape in smaller triangles: edges longer than `longest` [m] are split in the middle, in both triangles,
/// until there are none. The first vertices are the surface's own. At most about `most` triangles come of it: where
/// more would be needed, longer edges stay.
Surface refineSurface(const Surface& surface, double longest, std::size_t most = 400'000);

}  // namespace palpate
