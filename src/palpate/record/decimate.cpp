#include "palpate/record/decimate.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate {

namespace {

/// Adds the rows of the smallest and largest finite value in [begin, end), and of the first gap, so that it is kept.
void addExtremes(const std::vector<double>& values, std::size_t begin, std::size_t end,
                 std::vector<std::size_t>& rows) {
  std::size_t low = end, high = end, gap = end;
  for (std::size_t i = begin; i < end; ++i) {
    if (!std::isfinite(values[i])) {
      if (gap == end) gap = i;
      continue;
    }
    if (low == end || values[i] < values[low]) low = i;
    if (high == end || values[i] > values[high]) high = i;
  }
  for (const std::size_t i : {low, high, gap}) {
    if (i != end) rows.push_back(i);
  }
}

}  // namespace

std::vector<std::size_t> decimate(std::size_t rows, std::span<const std::vector<double>* const> series,
                                  std::size_t max_rows) {
  std::vector<std::size_t> chosen;
  if (rows <= max_rows || series.empty()) {
    chosen.resize(rows);
    std::iota(chosen.begin(), chosen.end(), std::size_t{0});
    return chosen;
  }
  const std::size_t stretches = std::max<std::size_t>(1, max_rows / (2 * series.size()));
  chosen.push_back(0);
  for (std::size_t k = 0; k < stretches; ++k) {
    const std::size_t begin = rows * k / stretches, end = rows * (k + 1) / stretches;
    for (const std::vector<double>* values : series) addExtremes(*values, begin, end, chosen);
  }
  chosen.push_back(rows - 1);
  std::sort(chosen.begin(), chosen.end());
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  return chosen;
}

}  // namespace palpate
