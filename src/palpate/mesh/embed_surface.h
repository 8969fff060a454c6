#pragma once

#include <optional>
#include <string>

#include "palpate/mesh/surface_repair.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// How far a surface that is simplified may be from the one given, unless something else is asked for: the lesser of so
/// many cells and so much of its bounding box's diagonal, half of the gap that contact keeps by default.
inline constexpr double kSurfaceTolerance = 0.01;
inline constexpr double kSurfaceToleranceOfSize = 0.001;

struct EmbedOptions {
  /// Wanted count, 1 to 200,000; the cell size is searched for it. 0: as many as the thinnest parts that matter need
  /// (see EmbedReport::suggested_tetrahedra), 300 to 20,000.
  int target_tetrahedra = 300;
  double cell_size = 0;           ///< [m]; if positive, this cell size is used and the target ignored
  double count_tolerance = 0.02;  ///< the search stops when the count is this close, relative
  /// Pieces that fill less than this of their tetrahedron go to a neighbor if they have a node of their own and that is
  /// sound. The surface in them then leaves its tetrahedron, and what two hosts say of it differs where they meet.
  double smallest_fill = 0.02;
  /// [m] How far the surface that is embedded may be from the one given, to have fewer triangles (see simplifySurface);
  /// absent: kSurfaceTolerance; 0: all triangles stay.
  std::optional<double> surface_tolerance = 0.0;
  /// Tell separate pieces of the solid in one lattice tetrahedron apart (Molino et al. 2004). Without, limbs that share
  /// a lattice tetrahedron are fused; kept for comparison.
  bool virtual_nodes = true;
  std::string name = "surface";  ///< for messages
};

struct EmbedReport {
  RepairReport repair;
  int given_triangles = 0;       ///< of the repaired surface, before it was simplified
  double surface_deviation = 0;  ///< [m] of the simplified surface from that
  int tetrahedra = 0;
  int nodes = 0;
  int components = 0;        ///< of the simulation mesh, connected through faces: each has six rigid modes, no hinge
  int solid_components = 0;  ///< of the surface, connected through edges, cavities not counted
  int bridges = 0;           ///< places where the solid is thinner than a sample, made solid to keep the mesh whole
  int seams = 0;             ///< places left where the surface may open, as the mesh under it is not connected nearby
  double overlap_share = 0;  ///< volume in more than one of the surface's solids, counted once; of the whole
  double thickness = 0;      ///< [m] a twentieth of the surface has less solid under it
  double thin_share = 0;     ///< of the surface, with less than a cell of solid under it: there it is too stiff
  int suggested_tetrahedra = 0;  ///< about how many have cells as small as `thickness`
  int split_tetrahedra = 0;      ///< lattice tetrahedra with more than one copy
  int merged_slivers = 0;        ///< pieces given to a neighbor
  double cell_size = 0;          ///< [m]
  int subdivision = 0;           ///< samples a tetrahedron: its cube
  int trials = 0;                ///< cell sizes tried
  double surface_volume = 0;     ///< [m^3] holes capped
  double sampled_volume = 0;     ///< [m^3] before it was matched to the surface's
  double mesh_volume = 0;        ///< [m^3] sum of fill * volume
  double center_error = 0;       ///< [m] distance of the mesh's center of mass from the surface's
  int vertices_outside = 0;      ///< surface vertices with a weight below -1e-9
  double smallest_weight = 0;
  double smallest_fill = 0;
  double smallest_dihedral_deg = 0;
  double worst_radius_ratio = 0;  ///< 3 inradius / circumradius, 1 is regular
  /// Stiffness of the node that is held least, of the median node's (diagonal of the stiffness, by what resists): a
  /// contact there gives way by its inverse. The lattice's elements are all alike; what varies is how far they are
  /// filled.
  double softest_node = 0;
  double seconds = 0;
};

/// Simulation mesh of a surface: a body-centered cubic lattice cut to the solid, with virtual nodes, the surface
/// embedded. The surface is repaired first (see repairSurface); holes, flipped triangles and duplicate vertices are
/// survived. The result's surface is the repaired one, simplified if `surface_tolerance` allows that, its triangles
/// split until none is larger than a lattice cell. Mesh, mass and center of mass are those of the surface as it was
/// given. Total mass and center of mass are the surface's. Throws InputError(options.name, ...) if the surface bounds
/// no volume or an option is out of range.
SimulationMesh embedSurface(const Surface& surface, const EmbedOptions& options = {}, EmbedReport* report = nullptr);

}  // namespace palpate
