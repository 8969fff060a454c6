#pragma once

#include <vector>

namespace palpate {

/// Value that a share (0 to 1) of the values does not exceed, by the nearest-rank rule; 0 without values.
double percentile(std::vector<double> values, double share);

}  // namespace palpate
