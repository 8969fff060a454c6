#pragma once

#include <string>
#include <string_view>

#include "palpate/mesh/types.h"

namespace palpate {

/// Reads a tetrahedral mesh by the file name's ending: Gmsh .msh (text, versions 2.2 and 4.1), legacy VTK .vtk (text,
/// unstructured grid), TetGen .node or .ele (both files, same stem). Other kinds of elements are skipped; unused nodes
/// are dropped. Throws InputError: unknown kind, missing, truncated or malformed file, bad index, no tetrahedra, flat
/// ones, more than 1,000,000 of them.
TetrahedralMesh readTetrahedra(const std::string& path);

/// For tests and fuzzing: the same from memory.
TetrahedralMesh readGmsh(std::string_view data, const std::string& name);
TetrahedralMesh readVtk(std::string_view data, const std::string& name);
TetrahedralMesh readTetGen(std::string_view nodes, std::string_view elements, const std::string& name);

/// Writes a legacy VTK file (text, unstructured grid) with cell data `fill`. Throws InputError if it cannot.
void writeVtk(const std::string& path, const SimulationMesh& mesh);

}  // namespace palpate
