#include "palpate/mesh/tetrahedral_io.h"

#include <filesystem>
#include <unordered_map>

#include "palpate/common/error.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {
namespace {

constexpr size_t kLargestMesh = 1'000'000;

/// Nodes by the file's own numbers, tetrahedra in these numbers until all is read.
class Collector {
 public:
  explicit Collector(const std::string& name) : name_(name) {}

  void node(long long tag, const Vec3& x) {
    if (!index_.try_emplace(tag, static_cast<int>(mesh_.nodes.size())).second)
      throw InputError(name_, "node " + std::to_string(tag), "comes twice");
    mesh_.nodes.push_back(x);
  }
  void tetrahedron(const std::array<long long, 4>& tags) {
    if (tags_.size() >= kLargestMesh)
      throw InputError(name_, "", "has more than 1,000,000 tetrahedra, which is the limit");
    tags_.push_back(tags);
  }

  TetrahedralMesh finish() {
    TetrahedralMesh result;
    std::vector<int> renumbered(mesh_.nodes.size(), -1);
    for (size_t i = 0; i < tags_.size(); ++i) {
      std::array<int, 4> t{};
      for (size_t k = 0; k < 4; ++k) {
        const auto it = index_.find(tags_[i][k]);
        if (it == index_.end())
          throw InputError(name_, "tetrahedron " + std::to_string(i + 1),
                           "there is no node " + std::to_string(tags_[i][k]));
        int& n = renumbered[static_cast<size_t>(it->second)];
        if (n < 0) {
          n = static_cast<int>(result.nodes.size());
          result.nodes.push_back(mesh_.nodes[static_cast<size_t>(it->second)]);
        }
        t[k] = n;
      }
      result.tetrahedra.push_back(t);
    }
    // Checks volumes and turns inverted tetrahedra.
    return simulationMeshOf(std::move(result), name_).mesh;
  }

 private:
  std::string name_;
  TetrahedralMesh mesh_;
  std::unordered_map<long long, int> index_;
  std::vector<std::array<long long, 4>> tags_;
};

Vec3 anyVector(TextScanner& scan) {
  const double x = scan.anyNumber("x");
  const double y = scan.anyNumber("y");
  const double z = scan.anyNumber("z");
  return {x, y, z};
}

std::array<long long, 4> anyFour(TextScanner& scan) {
  std::array<long long, 4> tags{};
  for (long long& tag : tags) tag = scan.anyInteger("a node");
  return tags;
}

constexpr long long kGmshTetrahedron = 4;
constexpr long long kVtkTetrahedron = 10;

void readGmsh2(TextScanner& scan, std::string_view section, Collector& mesh) {
  const long long count = scan.anyInteger("a count");
  for (long long i = 0; i < count; ++i) {
    if (section == "$Nodes") {
      const long long tag = scan.anyInteger("a node's number");
      mesh.node(tag, anyVector(scan));
      continue;
    }
    scan.anyInteger("an element's number");
    const long long type = scan.integer("an element's type");
    const long long labels = scan.integer("the number of tags");
    if (type == kGmshTetrahedron) {
      for (long long k = 0; k < labels; ++k) scan.integer("a tag");
      mesh.tetrahedron(anyFour(scan));
    }
    scan.skipRestOfLine();
  }
}

void readGmsh4(TextScanner& scan, std::string_view section, Collector& mesh) {
  const long long blocks = scan.anyInteger("the number of blocks");
  scan.skipRestOfLine();
  for (long long b = 0; b < blocks; ++b) {
    scan.anyInteger("a dimension");
    scan.integer("an entity");
    const long long kind = scan.integer("a type");
    const long long count = scan.integer("a count");
    if (section == "$Nodes") {
      if (kind != 0) scan.fail("parametric nodes are not read");
      std::vector<long long> tags;
      for (long long i = 0; i < count; ++i) tags.push_back(scan.anyInteger("a node's number"));
      for (long long tag : tags) mesh.node(tag, anyVector(scan));
      continue;
    }
    for (long long i = 0; i < count; ++i) {
      scan.anyInteger("an element's number");
      if (kind == kGmshTetrahedron) mesh.tetrahedron(anyFour(scan));
      scan.skipRestOfLine();
    }
  }
}

}  // namespace

TetrahedralMesh readGmsh(std::string_view data, const std::string& name) {
  TextScanner scan(data, name);
  scan.setComment(0);
  Collector mesh(name);
  double version = 0;
  while (scan.nextLine()) {
    const std::string_view section = scan.word();
    if (section == "$MeshFormat") {
      version = scan.anyNumber("the version");
      if (scan.integer("the file type") != 0) scan.fail("binary .msh files are not read: save as text");
      if (!(version >= 2 && version < 3) && version != 4.1) scan.fail("versions 2.2 and 4.1 are read");
    } else if (section == "$Nodes" || section == "$Elements") {
      if (version == 0) scan.fail("the section $MeshFormat is missing");
      (version < 3 ? readGmsh2 : readGmsh4)(scan, section, mesh);
    }
  }
  return mesh.finish();
}

TetrahedralMesh readVtk(std::string_view data, const std::string& name) {
  TextScanner scan(data, name);
  scan.setComment(0);
  if (!scan.nextLine() || scan.word() != "#") scan.fail("a legacy VTK file begins with '# vtk DataFile'");
  scan.nextLine();  // title
  if (scan.nextLine() && scan.word() != "ASCII") scan.fail("only ASCII files are read");
  Collector mesh(name);
  std::vector<std::vector<long long>> cells;
  std::vector<long long> types;
  while (scan.nextLine()) {
    const std::string_view keyword = scan.word();
    if (keyword == "DATASET" && scan.word() != "UNSTRUCTURED_GRID") scan.fail("only UNSTRUCTURED_GRID is read");
    if (keyword == "POINTS") {
      const long long count = scan.integer("the number of points");
      scan.skipRestOfLine();
      for (long long i = 0; i < count; ++i) mesh.node(i, anyVector(scan));
    } else if (keyword == "CELLS") {
      const long long count = scan.integer("the number of cells");
      scan.skipRestOfLine();
      for (long long i = 0; i < count; ++i) {
        const long long corners = scan.anyInteger("the number of corners (the layout before version 5)");
        cells.emplace_back();
        for (long long c = 0; c < corners; ++c) cells.back().push_back(scan.anyInteger("a point"));
      }
    } else if (keyword == "CELL_TYPES") {
      const long long count = scan.integer("the number of cells");
      scan.skipRestOfLine();
      for (long long i = 0; i < count; ++i) types.push_back(scan.anyInteger("a cell type"));
    }
  }
  if (types.size() != cells.size()) throw InputError(name, "CELL_TYPES", "must be as many as CELLS");
  for (size_t i = 0; i < cells.size(); ++i) {
    if (types[i] != kVtkTetrahedron) continue;
    if (cells[i].size() != 4) throw InputError(name, "cell " + std::to_string(i), "a tetrahedron has four corners");
    mesh.tetrahedron({cells[i][0], cells[i][1], cells[i][2], cells[i][3]});
  }
  return mesh.finish();
}

TetrahedralMesh readTetGen(std::string_view nodes, std::string_view elements, const std::string& name) {
  Collector mesh(name);
  TextScanner points(nodes, name + ".node");
  const long long count = points.anyInteger("the number of points");
  if (points.integer("the dimension") != 3) points.fail("the dimension must be 3");
  points.skipRestOfLine();
  for (long long i = 0; i < count; ++i) {
    const long long tag = points.anyInteger("a point's number");
    mesh.node(tag, anyVector(points));
    points.skipRestOfLine();
  }
  TextScanner cells(elements, name + ".ele");
  const long long tetrahedra = cells.anyInteger("the number of tetrahedra");
  cells.skipRestOfLine();
  for (long long i = 0; i < tetrahedra; ++i) {
    cells.anyInteger("a tetrahedron's number");
    mesh.tetrahedron(anyFour(cells));
    cells.skipRestOfLine();
  }
  return mesh.finish();
}

TetrahedralMesh readTetrahedra(const std::string& path) {
  const std::string ending = endingOf(path);
  if (ending == ".msh") return readGmsh(readFile(path), path);
  if (ending == ".vtk") return readVtk(readFile(path), path);
  if (ending == ".node" || ending == ".ele") {
    const std::string stem = std::filesystem::path(path).replace_extension().string();
    return readTetGen(readFile(stem + ".node"), readFile(stem + ".ele"), stem);
  }
  throw InputError(path, "", "unknown kind of tetrahedral mesh: the name must end in .msh, .vtk, .node or .ele");
}

void writeVtk(const std::string& path, const SimulationMesh& mesh) {
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
  writeFile(path, out);
}

}  // namespace palpate
