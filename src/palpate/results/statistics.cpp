#include "palpate/results/statistics.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace palpate {

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto count = static_cast<double>(values.size());
  const auto rank = static_cast<std::size_t>(std::clamp(std::ceil(share * count) - 1.0, 0.0, count - 1.0));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(rank), values.end());
  return values[rank];
}

}  // namespace palpate
