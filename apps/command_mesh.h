#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/study/mesh_stiffness.h"

// What `palpate mesh` does, without its command line. All throw InputError for bad input.

namespace palpate {

/// `mesh embed SURFACE --tets N|auto [--size S] [--tolerance T] [--out FILE]`
struct EmbedCommand {
  std::string surface;
  int tetrahedra = 300;               ///< 0: as many as the thinnest parts that matter need
  double size = 0;                    ///< [m] longest side of the bounding box; 0 keeps the file's lengths
  std::string out;                    ///< .vtu or .vtk; empty for none
  std::optional<double> tolerance{};  ///< [m] EmbedOptions::surface_tolerance
};
struct EmbedSummary {
  std::string surface;
  int surface_vertices = 0;   ///< as embedded
  int surface_triangles = 0;  ///< as embedded
  EmbedReport embed;
};
EmbedSummary runMeshEmbed(const EmbedCommand& command);
std::string formatReport(const EmbedSummary& summary);

/// `mesh stiffness SURFACE [--tets N...] [--size S]`: how the stiffness of the whole depends on the number of
/// tetrahedra.
struct StiffnessCommand {
  std::string surface;
  std::vector<int> tetrahedra = {300, 1000, 3000, 10'000};
  double size = 0;  ///< [m] as for embed
};
struct StiffnessSummary {
  std::string surface;
  std::vector<MeshStiffness> meshes;  ///< as asked for, fewest tetrahedra first
};
StiffnessSummary runMeshStiffness(const StiffnessCommand& command);
std::string formatReport(const StiffnessSummary& summary);

/// `mesh info SURFACE`: what is in the file, before and after repair.
struct InfoSummary {
  std::string surface;
  int file_vertices = 0;
  int file_triangles = 0;
  RepairReport repair;
  SurfaceMeasures measures;  ///< repaired, see measureSolid()
  TriangleQuality quality;   ///< repaired
  Bounds bounds;
};
InfoSummary runMeshInfo(const std::string& surface);
std::string formatReport(const InfoSummary& summary);

/// `mesh info MESH` of a tetrahedral mesh: what a scene with `tetrahedra_file` would simulate.
struct TetrahedraInfo {
  std::string mesh;
  int tetrahedra = 0, nodes = 0;
  int surface_nodes = 0;  ///< on the boundary, which is the surface
  int surface_triangles = 0;
  double volume = 0;  ///< [m^3]
  TetrahedraQuality quality;
  Bounds bounds;
  std::vector<std::string> notes;  ///< what the file holds besides
};
TetrahedraInfo runTetrahedraInfo(const std::string& mesh);
std::string formatReport(const TetrahedraInfo& info);

/// `mesh make SHAPE --out FILE [--size S]`: alien (height), box (edge), sphere (diameter), capsule (length, a quarter
/// of it thick) as surfaces; bar (edge) also as .vtk, 4 x 4 x 3 cells unless given.
struct MakeCommand {
  std::string shape;
  std::string out;
  double size = 0;  ///< [m]; 0: 0.2 for the alien, 0.08 for the bar, 0.1 for the others
  std::array<int, 3> cells = {4, 4, 3};
};
struct MakeSummary {
  std::string shape;
  std::string out;
  int vertices = 0;
  int triangles = 0;
  int tetrahedra = 0;
};
MakeSummary runMeshMake(const MakeCommand& command);
std::string formatReport(const MakeSummary& summary);

}  // namespace palpate
