#pragma once

#include <gtest/gtest.h>

#ifdef __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wsign-compare"
#pragma GCC diagnostic ignored "-Wconversion"
#ifndef __clang__
#pragma GCC diagnostic ignored "-Wuseless-cast"
#endif
#endif
#define STB_IMAGE_IMPLEMENTATION
#define STB_IMAGE_STATIC
#define STBI_ONLY_PNG
#define STBI_NO_STDIO
#include <stb_image.h>
#ifdef __GNUC__
#pragma GCC diagnostic pop
#endif

#include <vector>

#include "palpate/picture/types.h"

namespace palpate::testing {

/// The pixels of a PNG file; nothing, and a failed test, if it is none. For links with palpate_picture.
inline Bitmap decodePng(const std::vector<unsigned char>& png) {
  Bitmap out;
  int channels = 0;
  stbi_uc* pixels =
      stbi_load_from_memory(png.data(), static_cast<int>(png.size()), &out.width, &out.height, &channels, 3);
  if (pixels == nullptr) {
    ADD_FAILURE() << "no PNG: " << stbi_failure_reason();
    return {};
  }
  out.rgb.assign(pixels, pixels + 3 * out.width * out.height);
  stbi_image_free(pixels);
  return out;
}

}  // namespace palpate::testing
