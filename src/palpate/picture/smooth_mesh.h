#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "palpate/picture/types.h"

namespace palpate {

/// A mesh with a normal at each vertex. Vertices on sharp edges are there once a side.
struct SmoothMesh {
  std::vector<Eigen::Vector3f> positions;  ///< [m], less the origin that was given
  std::vector<Eigen::Vector3f> normals;    ///< unit
  std::vector<Eigen::Vector3f> colors;     ///< linear light, not sRGB
  std::vector<std::array<int, 3>> triangles;
};

/// Normals weighted by area, over the triangles at a vertex that turn away by less than 40 degrees.
/// @param origin  taken off the positions before they become single precision
SmoothMesh smoothMesh(const PictureMesh& mesh, const Vec3& origin);

/// Divides every triangle into four until the mean edge is at most `edge` [m], so that light computed at the vertices
/// is fine enough; stops before there are more than `limit` triangles.
void refine(SmoothMesh& mesh, double edge, std::size_t limit);

}  // namespace palpate
