#pragma once

#include <array>
#include <map>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "palpate/mesh/types.h"

// Readers of tetrahedral meshes, used by tetrahedral_io.cpp only, and what they have in common.

namespace palpate {

/// What a cell of a mesh file is, as far as it matters here.
enum class CellFamily { flat, tetrahedron, pyramid, prism, hexahedron, polyhedron, unknown };

/// Collects nodes by the file's own numbers, and cells in these numbers until all is read.
class CellCollector {
 public:
  explicit CellCollector(const std::string& name) : name_(name) {}

  /// Throws InputError if the number was there before.
  void node(long long number, const Vec3& x);
  /// A cell and its nodes, corners first. Throws InputError for a tetrahedron of fewer than four or other than 4 nodes
  /// or more than a million.
  void cell(CellFamily family, const std::vector<long long>& nodes);
  /// Tells apart what is no tetrahedron: its nodes do not matter.
  void leaveOut(CellFamily family) { ++left_out_[family]; }

  /// The tetrahedra with the nodes that they need, each turned to have a positive volume, repeated ones left out.
  /// @param notes  gets a line on everything that is left out but faces, lines and points; may be null
  /// Throws InputError for unknown nodes, no tetrahedra (saying what there is instead), flat ones.
  TetrahedralMesh finish(std::vector<std::string>* notes);

 private:
  std::vector<std::array<long long, 4>> withoutRepeated(std::vector<std::string>& notes) const;
  std::vector<std::string> leftOut() const;
  [[noreturn]] void refuse() const;

  std::string name_;
  std::vector<Vec3> nodes_;
  std::unordered_map<long long, int> index_;
  std::vector<std::array<long long, 4>> tetrahedra_;
  std::map<CellFamily, std::size_t> left_out_;
  std::size_t curved_ = 0;
};

/// Gmsh: versions 1, 2, 4.0 and 4.1, text and binary.
void readGmshCells(std::string_view data, const std::string& name, CellCollector& cells);
/// Legacy VTK: up to version 5.1, text and binary.
void readVtkCells(std::string_view data, const std::string& name, CellCollector& cells);
/// VTU: text, and binary in place or appended, raw or base64, compressed by zlib or not.
void readVtuCells(std::string_view data, const std::string& name, CellCollector& cells);
/// TetGen: .node and .ele.
void readTetGenCells(std::string_view nodes, std::string_view elements, const std::string& name, CellCollector& cells);

/// Family of a VTK cell type; `flat` for faces, lines and points.
CellFamily vtkFamily(long long type);

}  // namespace palpate
