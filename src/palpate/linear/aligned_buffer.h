#pragma once

#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Storage of matrices that grow on demand; aligned, as Eigen's own are: otherwise the heap decides how sums are split,
/// and the last bits with it.
using AlignedBuffer = std::vector<double, Eigen::aligned_allocator<double>>;

inline void grow(AlignedBuffer& buffer, Eigen::Index size) {
  if (buffer.size() < static_cast<std::size_t>(size)) buffer.resize(static_cast<std::size_t>(size));
}

}  // namespace palpate
