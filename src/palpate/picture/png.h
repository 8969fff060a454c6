#pragma once

#include <vector>

#include "palpate/picture/types.h"

namespace palpate {

/// The bitmap as a PNG file. @throws std::runtime_error if it cannot be encoded
std::vector<unsigned char> encodePng(const Bitmap& bitmap);

/// Pictures of one size side by side, `columns` a row, `gap` white pixels apart.
Bitmap sheet(const std::vector<Bitmap>& pictures, int columns, int gap);

}  // namespace palpate
