#include "palpate/mesh/surface_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {

void readObj(std::string_view data, SurfaceBuilder& builder) {
  TextScanner scan(data, builder.name());
  while (scan.nextLine()) {
    const std::string_view keyword = scan.word();
    if (keyword == "v") {
      const double x = scan.number("x");
      const double y = scan.number("y");
      const double z = scan.number("z");
      builder.addVertex({x, y, z});
    } else if (keyword == "f") {
      builder.beginPolygon(scan.line());
      for (std::string_view w = scan.word(); !w.empty(); w = scan.word()) {
        if (w == "\\") {
          // The statement goes on in the next line.
          if (!scan.nextLine()) scan.fail("the file ends within a face");
          continue;
        }
        // vertex/texture/normal: only the vertex counts; negative ones count back from the newest.
        const long long index = scan.toInteger(w.substr(0, w.find('/')), "a vertex index");
        if (index == 0) scan.fail("vertex indices start at 1, not 0");
        builder.corner(index > 0 ? index - 1 : static_cast<long long>(builder.vertices()) + index);
      }
      builder.endPolygon();
    }
    // Normals, texture, groups and materials say nothing about the shape.
  }
}

}  // namespace palpate
