#include "palpate/mesh/tetrahedral_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {

void readTetGenCells(std::string_view nodes, std::string_view elements, const std::string& name, CellCollector& cells) {
  TextScanner points(nodes, name + ".node");
  const long long count = points.anyInteger("the number of points");
  if (points.integer("the dimension") != 3) points.fail("the dimension must be 3");
  points.skipRestOfLine();
  for (long long i = 0; i < count; ++i) {
    const long long number = points.anyInteger("a point's number");
    const double x = points.anyNumber("x");
    const double y = points.anyNumber("y");
    const double z = points.anyNumber("z");
    cells.node(number, {x, y, z});
    points.skipRestOfLine();
  }
  TextScanner elements_scan(elements, name + ".ele");
  const long long tetrahedra = elements_scan.anyInteger("the number of tetrahedra");
  elements_scan.skipRestOfLine();
  std::vector<long long> corners(4);
  for (long long i = 0; i < tetrahedra; ++i) {
    elements_scan.anyInteger("a tetrahedron's number");
    for (long long& corner : corners) corner = elements_scan.anyInteger("a node");
    cells.cell(CellFamily::tetrahedron, corners);
    elements_scan.skipRestOfLine();
  }
}

}  // namespace palpate
