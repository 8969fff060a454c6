#pragma once

#include "palpate/picture/types.h"

namespace palpate {

/// Draws the scene with a z-buffer, four samples a pixel, soft shadows and a light background (docs/pictures.md). The
/// same scene gives the same bytes.
/// @param width, height  [px], 1 to 8192
/// @throws std::logic_error if a triangle or a color refers to nothing
Bitmap render(const PictureScene& scene, int width, int height);

}  // namespace palpate
