#include "palpate/picture/png.h"

#include <algorithm>
#include <stdexcept>

#ifdef __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wsign-compare"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#endif
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#define STBI_WRITE_NO_STDIO
#include <stb_image_write.h>
#ifdef __GNUC__
#pragma GCC diagnostic pop
#endif

namespace palpate {

std::vector<unsigned char> encodePng(const Bitmap& bitmap) {
  std::vector<unsigned char> out;
  const auto append = [](void* context, void* data, int size) {
    auto& bytes = *static_cast<std::vector<unsigned char>*>(context);
    const auto* begin = static_cast<const unsigned char*>(data);
    bytes.insert(bytes.end(), begin, begin + size);
  };
  stbi_write_png_compression_level = 12;  // a little smaller than the default for little time
  if (stbi_write_png_to_func(append, &out, bitmap.width, bitmap.height, 3, bitmap.rgb.data(), 3 * bitmap.width) == 0) {
    throw std::runtime_error("a picture could not be encoded as PNG");
  }
  return out;
}

Bitmap sheet(const std::vector<Bitmap>& pictures, int columns, int gap) {
  Bitmap out;
  if (pictures.empty()) return out;
  const int width = pictures.front().width, height = pictures.front().height;
  const int count = static_cast<int>(pictures.size());
  const int across = std::clamp(columns, 1, count), down = (count + across - 1) / across;
  out.width = across * width + (across - 1) * gap;
  out.height = down * height + (down - 1) * gap;
  out.rgb.assign(static_cast<std::size_t>(3) * out.width * out.height, 255);
  for (int i = 0; i < count; ++i) {
    const int left = (i % across) * (width + gap), top = (i / across) * (height + gap);
    for (int y = 0; y < height; ++y) {
      const auto row = pictures[i].rgb.begin() + static_cast<std::ptrdiff_t>(3) * width * y;
      std::copy(
          row, row + static_cast<std::ptrdiff_t>(3) * width,
          out.rgb.begin() + static_cast<std::ptrdiff_t>(3) * (static_cast<std::ptrdiff_t>(top + y) * out.width + left));
    }
  }
  return out;
}

}  // namespace palpate
