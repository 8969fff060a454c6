#pragma once

#include <vector>

#include "palpate/live/live_model.h"
#include "palpate/reduction/contact_clusters.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// Where a rigid tool is flat (a face, an edge) and the obstacle is round or sharp, the place where they touch moves
/// over the tool: finds what is flat around it, and begins where that is nearest to the obstacle. The gap stays.
/// Changes nothing where the tool gives way or is not flat, or where the obstacle is.
/// @param surface  of the cluster, with an obstacle; a sharp edge or corner of it becomes a thin capsule or a small
/// ball
/// @param place    of the cluster on the tool, world; is moved [m]
void placeOnFlat(const World& world, const std::vector<TouchPoint>& points, const TouchCluster& cluster,
                 LiveSurface& surface, Vec3& place);

}  // namespace palpate
