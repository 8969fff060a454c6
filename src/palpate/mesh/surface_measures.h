#pragma once

#include <string>
#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// Integrals over the solid that a closed, outward-oriented surface bounds (density 1).
struct SurfaceMeasures {
  double area = 0;                     ///< [m^2]
  double volume = 0;                   ///< [m^3], negative if the surface points inward
  Vec3 center_of_mass = Vec3::Zero();  ///< [m]; the bounding box's center where the volume is zero
  Mat3 inertia = Mat3::Zero();         ///< [m^5] about the center of mass; times density gives kg m^2
};

/// By the divergence theorem: one signed tetrahedron a triangle. Exact for closed surfaces only (see capHoles).
SurfaceMeasures measureSurface(const Surface& surface);

/// Of a surface with its holes capped (the area, too, is with the caps), where volume that lies in several of its
/// solids counts once, by the winding number: what overlaps is integrated along a grid of lines, within about 1e-6 of
/// the whole. Exact where no more than 0.2 % overlaps, which is left as it is. Inner shells that point into a cavity
/// leave it out.
SurfaceMeasures measureSolid(const Surface& surface);

/// Of a rigid body.
struct MassProperties {
  double mass = 0;                     ///< [kg]
  Vec3 center_of_mass = Vec3::Zero();  ///< [m], in the surface's frame
  Mat3 inertia = Mat3::Zero();         ///< [kg m^2] about the center of mass, along the surface's axes
};

/// Of the homogeneous solid inside an outward-oriented surface, see measureSolid().
/// @param density  [kg/m^3]
/// @throws InputError(name, ...) unless the surface bounds a positive volume and the density is positive
MassProperties surfaceMassProperties(const Surface& surface, double density, const std::string& name = "surface");

/// How the triangles hang together. An edge is identified by its two vertex indices, so weld duplicates first.
struct SurfaceTopology {
  int components = 0;          ///< pieces connected by shared vertices
  int boundary_edges = 0;      ///< edges with one triangle
  int holes = 0;               ///< connected sets of boundary edges
  int nonmanifold_edges = 0;   ///< edges with three triangles or more
  int inconsistent_edges = 0;  ///< edges whose two triangles run along them in the same direction
  int euler = 0;               ///< used vertices - edges + triangles; 2 for each closed component of genus 0

  bool closed() const { return boundary_edges == 0 && nonmanifold_edges == 0 && inconsistent_edges == 0; }
};

SurfaceTopology inspectTopology(const Surface& surface);

/// The surface with every hole closed by a fan about the hole's centroid (appended triangles; the first ones are the
/// surface's own). The result has no boundary as a chain of oriented edges, so its volume and winding number are exact.
Surface capHoles(const Surface& surface);

/// Axis-aligned bounding box [m]; {0, 0} for an empty set.
struct Bounds {
  Vec3 low = Vec3::Zero();
  Vec3 high = Vec3::Zero();
  Vec3 center() const { return 0.5 * (low + high); }
  double diagonal() const { return (high - low).norm(); }
};

Bounds boundsOf(const std::vector<Vec3>& points);

/// Area-weighted unit normals, one a vertex; zero for vertices without triangles.
std::vector<Vec3> vertexNormals(const Surface& surface);

}  // namespace palpate
