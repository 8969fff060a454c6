#pragma once

#include <vector>

#include "palpate/mesh/inside_field.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Thickness of the solid [m] under places spread evenly over its surface, increasing: how far it goes inward along the
/// normal. Places where nothing lies under the surface are left out.
/// @param places  about how many
std::vector<double> solidThickness(const Surface& surface, const InsideField& field, int places = 2000);

/// The thickness that the given share of the surface falls short of [m]; 0 of an empty list.
double thicknessAt(const std::vector<double>& thickness, double share);

}  // namespace palpate
