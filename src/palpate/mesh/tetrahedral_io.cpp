#include "palpate/mesh/tetrahedral_io.h"

#include <filesystem>

#include "palpate/common/error.h"
#include "palpate/mesh/tetrahedral_formats.h"
#include "palpate/mesh/text_scanner.h"
#include "palpate/mesh/vtu_file.h"

namespace palpate {
namespace {

bool isXml(std::string_view data) {
  const std::size_t begin = data.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  return begin != std::string_view::npos && data[begin] == '<';
}

[[noreturn]] void refuseEnding(const std::string& path, const std::string& ending) {
  if (ending == ".med") throw InputError(path, "", "MED files are not read: save the mesh as .msh, .vtu or .vtk");
  if (ending == ".pvtu") throw InputError(path, "", "a .pvtu names other files: give one .vtu with the whole mesh");
  throw InputError(path, "", "unknown kind of tetrahedral mesh: the name must end in .vtu, .vtk, .msh, .node or .ele");
}

}  // namespace

TetrahedralMesh readGmsh(std::string_view data, const std::string& name, std::vector<std::string>* notes) {
  CellCollector cells(name);
  readGmshCells(data, name, cells);
  return cells.finish(notes);
}

TetrahedralMesh readVtk(std::string_view data, const std::string& name, std::vector<std::string>* notes) {
  CellCollector cells(name);
  isXml(data) ? readVtuCells(data, name, cells) : readVtkCells(data, name, cells);
  return cells.finish(notes);
}

TetrahedralMesh readTetGen(std::string_view nodes, std::string_view elements, const std::string& name) {
  CellCollector cells(name);
  readTetGenCells(nodes, elements, name, cells);
  return cells.finish(nullptr);
}

TetrahedralMesh readTetrahedra(const std::string& path, std::vector<std::string>* notes) {
  const std::string ending = endingOf(path);
  if (ending == ".msh") return readGmsh(readFile(path), path, notes);
  if (ending == ".vtk" || ending == ".vtu") return readVtk(readFile(path), path, notes);
  if (ending == ".node" || ending == ".ele") {
    const std::string stem = std::filesystem::path(path).replace_extension().string();
    return readTetGen(readFile(stem + ".node"), readFile(stem + ".ele"), stem);
  }
  refuseEnding(path, ending);
}

namespace {

std::string legacyVtk(const SimulationMesh& mesh) {
  std::string out = "# vtk DataFile Version 3.0\nPalpate simulation mesh\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS " +
                    std::to_string(mesh.mesh.nodes.size()) + " double\n";
  for (const Vec3& x : mesh.mesh.nodes) {
    for (int d = 0; d < 3; ++d) {
      appendNumber(out, x[d]);
      out += d < 2 ? ' ' : '\n';
    }
  }
  const size_t n = mesh.mesh.tetrahedra.size();
  out += "CELLS " + std::to_string(n) + " " + std::to_string(5 * n) + "\n";
  for (const auto& t : mesh.mesh.tetrahedra) {
    out += "4";
    for (int v : t) {
      out += ' ';
      out += std::to_string(v);
    }
    out += "\n";
  }
  out += "CELL_TYPES " + std::to_string(n) + "\n";
  for (size_t i = 0; i < n; ++i) out += "10\n";
  out += "CELL_DATA " + std::to_string(n) + "\nSCALARS fill double 1\nLOOKUP_TABLE default\n";
  for (double f : mesh.fill) {
    appendNumber(out, f);
    out += '\n';
  }
  return out;
}

std::string vtuOf(const SimulationMesh& mesh) {
  VtuGrid grid;
  std::vector<double> x;
  for (const Vec3& p : mesh.mesh.nodes) x.insert(x.end(), p.data(), p.data() + 3);
  grid.points = {"Points", 3, std::move(x)};
  for (const auto& t : mesh.mesh.tetrahedra) grid.corners.insert(grid.corners.end(), t.begin(), t.end());
  grid.cell_data.push_back({"fill", 1, mesh.fill});
  return vtuBytes(grid);
}

}  // namespace

void writeSimulationMesh(const std::string& path, const SimulationMesh& mesh) {
  writeFile(path, endingOf(path) == ".vtu" ? vtuOf(mesh) : legacyVtk(mesh));
}

}  // namespace palpate
