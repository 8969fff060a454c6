#include <algorithm>
#include <cmath>

#include "palpate/common/error.h"
#include "palpate/mesh/byte_reader.h"
#include "palpate/mesh/surface_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {
namespace {

constexpr size_t kHeaderSize = 80;
constexpr size_t kRecordSize = 50;

/// Whether there are bytes that no text has.
bool isBinary(std::string_view data) {
  return std::any_of(data.begin(), data.end(), [](char c) { return c >= 0 && c < ' ' && (c < '\t' || c > '\r'); });
}

void readStlText(std::string_view data, SurfaceBuilder& builder) {
  TextScanner scan(data, builder.name());
  scan.setComment(0);
  int corners = -1;
  bool closed = false;
  while (scan.nextLine()) {
    const std::string_view keyword = scan.word();
    if (keyword == "facet") {
      if (corners >= 0) scan.fail("a facet begins within a facet");
      corners = 0;
      builder.beginPolygon(scan.line());
    } else if (keyword == "vertex") {
      if (corners < 0 || corners >= 3) scan.fail("a facet has three vertices");
      const double x = scan.number("x");
      const double y = scan.number("y");
      const double z = scan.number("z");
      builder.corner(static_cast<long long>(builder.vertices()));
      builder.addVertex({x, y, z});
      ++corners;
    } else if (keyword == "endfacet") {
      if (corners != 3) scan.fail("a facet has three vertices");
      builder.endPolygon();
      corners = -1;
    } else if (keyword == "endsolid") {
      closed = true;
    } else if (keyword != "solid" && keyword != "outer" && keyword != "endloop") {
      scan.fail("is neither a text nor a binary STL file");
    }
  }
  if (corners >= 0 || !closed) scan.fail("the file is truncated: endsolid is missing");
}

void readStlBinary(std::string_view data, uint32_t count, SurfaceBuilder& builder) {
  ByteReader bytes(data.substr(kHeaderSize + 4), false);
  for (uint32_t t = 0; t < count; ++t) {
    bytes.skip(3 * sizeof(float));  // the normal, which the corners give anyway
    builder.beginPolygon(static_cast<long long>(t) + 1);
    for (int c = 0; c < 3; ++c) {
      std::array<float, 3> x{};
      for (float& value : x) bytes.take(value);
      if (!std::isfinite(x[0]) || !std::isfinite(x[1]) || !std::isfinite(x[2]))
        throw InputError(builder.name(), "triangle " + std::to_string(t + 1), "a coordinate is not finite");
      builder.corner(static_cast<long long>(builder.vertices()));
      builder.addVertex({x[0], x[1], x[2]});
    }
    builder.endPolygon();
    bytes.skip(2);
  }
}

}  // namespace

void readStl(std::string_view data, SurfaceBuilder& builder) {
  uint32_t count = 0;
  const bool has_count = data.size() >= kHeaderSize + 4 && ByteReader(data.substr(kHeaderSize), false).take(count);
  const bool fits = has_count && data.size() - kHeaderSize - 4 == kRecordSize * static_cast<size_t>(count);
  // Some binary files begin with "solid" too, so the size decides first.
  if (fits) return readStlBinary(data, count, builder);
  const size_t word = data.find_first_not_of(" \t\r\n");
  // Where the size is wrong, count and first triangle tell, whose bytes are zero here and there.
  const bool binary = isBinary(has_count ? data.substr(kHeaderSize, 4 + kRecordSize) : data);
  if (!binary && word != std::string_view::npos && data.substr(word, 5) == "solid") return readStlText(data, builder);
  if (!has_count) throw InputError(builder.name(), "", "is truncated: a binary STL file has at least 84 bytes");
  if (data.size() - kHeaderSize - 4 < kRecordSize * static_cast<size_t>(count))
    throw InputError(builder.name(), "", "is truncated: its header promises " + std::to_string(count) + " triangles");
  readStlBinary(data, count, builder);
}

}  // namespace palpate
