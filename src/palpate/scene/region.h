#pragma once

#include <string>
#include <vector>

#include "palpate/scene/config.h"

namespace palpate {

/// The region with a landmark replaced by the sphere about it.
/// @param shape  of the body; only the alien has landmarks
/// @throws InputError for a landmark that the shape does not have
RegionConfig resolvedRegion(const RegionConfig& region, const ShapeConfig& shape);

/// Whether a point in rest coordinates [m] lies in the region or on its boundary. Landmarks hold nothing: resolve them.
bool contains(const RegionConfig& region, const Vec3& point);

/// For each point in rest coordinates [m] (a tetrahedron's centroid, say) the index of the last material part that
/// holds it, -1: none.
/// @throws InputError(body.name, "material.parts[i].region", ...) if a region holds no point at all
std::vector<int> materialPartsOf(const BodyConfig& body, const std::vector<Vec3>& points);

}  // namespace palpate
