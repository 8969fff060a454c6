#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace palpate {

/// Rows of one size as text for a terminal, each column as wide as its widest cell.
/// @param left  so many columns are aligned to the left, the others to the right
std::string alignedColumns(const std::vector<std::vector<std::string>>& rows, std::size_t left);

}  // namespace palpate
