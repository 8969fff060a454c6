#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// Reads a tetrahedral mesh by the file name's ending; lengths as in the file.
///   .vtu         VTK XML, unstructured grid: text, binary in place or appended, raw or base64, with zlib or without
///   .vtk         legacy VTK, unstructured grid, up to version 5.1: text, binary; or the above
///   .msh         Gmsh 1, 2, 4.0 and 4.1: text, binary
///   .node, .ele  TetGen: both files, same stem
/// Of tetrahedra with nodes between corners the corners count. Other kinds of elements and unused nodes are left out,
/// and a tetrahedron that comes twice counts once.
/// @param notes  gets a line on each of the above but faces, lines, points and unused nodes; may be null
/// Throws InputError: unknown kind, missing, truncated or malformed file, bad index, no tetrahedra (and what there is
/// instead), flat ones, more than 1,000,000 of them.
TetrahedralMesh readTetrahedra(const std::string& path, std::vector<std::string>* notes = nullptr);

/// For tests and fuzzing: the same from memory; readVtk also what a .vtu holds.
TetrahedralMesh readGmsh(std::string_view data, const std::string& name, std::vector<std::string>* notes = nullptr);
TetrahedralMesh readVtk(std::string_view data, const std::string& name, std::vector<std::string>* notes = nullptr);
TetrahedralMesh readTetGen(std::string_view nodes, std::string_view elements, const std::string& name);

/// Writes a legacy VTK file (text, unstructured grid) with cell data `fill`, or a VTU file (binary) if the name ends in
/// .vtu. Throws InputError if it cannot.
void writeSimulationMesh(const std::string& path, const SimulationMesh& mesh);

}  // namespace palpate
