#include "palpate/common/error.h"
#include "palpate/mesh/surface_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {

void readOff(std::string_view data, SurfaceBuilder& builder) {
  TextScanner scan(data, builder.name());
  std::string_view head = scan.anyWord("OFF");
  const bool keyword = head.size() >= 3 && head.substr(head.size() - 3) == "OFF";
  // Prefixes for colors (C), normals (N) and texture (ST) add columns behind the coordinates; 4 and n add dimensions.
  if (keyword && head != "OFF" && head != "COFF" && head != "NOFF" && head != "CNOFF" && head != "STOFF")
    scan.fail("only OFF, COFF, NOFF, CNOFF and STOFF are read");
  const long long vertices =
      keyword ? scan.anyInteger("the number of vertices") : scan.toInteger(head, "OFF or the number of vertices");
  const long long faces = scan.anyInteger("the number of faces");
  if (vertices < 0 || faces < 0) scan.fail("numbers of vertices and faces must not be negative");
  scan.skipRestOfLine();
  for (long long v = 0; v < vertices; ++v) {
    const double x = scan.anyNumber("x");
    const double y = scan.number("y");
    const double z = scan.number("z");
    builder.addVertex({x, y, z});
    scan.skipRestOfLine();
  }
  for (long long f = 0; f < faces; ++f) {
    const long long corners = scan.anyInteger("the number of corners");
    builder.beginPolygon(scan.line());
    for (long long c = 0; c < corners; ++c) builder.corner(scan.integer("a vertex index"));
    builder.endPolygon();
    scan.skipRestOfLine();
  }
}

}  // namespace palpate
