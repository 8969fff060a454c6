#pragma once

#include <array>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Red, green and blue as on a screen (sRGB), each 0 to 1.
using Color = Eigen::Vector3f;

/// Triangles to draw.
struct PictureMesh {
  std::vector<Vec3> vertices;                 ///< [m], world
  std::vector<std::array<int, 3>> triangles;  ///< counter-clockwise seen from outside
  std::vector<Color> colors;                  ///< one a vertex, or one for all
  float gloss = 0.15F;                        ///< strength of the highlight
  float inside = 1.0F;                        ///< brightness of triangles seen from behind, against the front's
  bool on_top = false;                        ///< drawn over everything else, without shadow: for arrows
};

/// A plane without end, seen from the side of its normal only. It is drawn as the background with shadows and a grid
/// that fade with the distance from the scene's focus.
struct PicturePlane {
  Vec3 point = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();  ///< unit
};

struct PictureCamera {
  Vec3 eye{1, -2, 1};               ///< [m]
  Vec3 direction{-0.4, 0.8, -0.4};  ///< of sight, unit; not along z
  double field_of_view = 0.5;       ///< vertical, from edge to edge [rad]
};

struct PictureScene {
  std::vector<PictureMesh> meshes;
  std::vector<PicturePlane> planes;
  PictureCamera camera;
  Vec3 focus = Vec3::Zero();  ///< center of what matters [m]; shadows and grid are there
  double radius = 0.1;        ///< of what matters, about focus [m]
  double grid = 0.02;         ///< spacing of the planes' grid [m]; 0: none
};

/// Rows from the top, three bytes (r, g, b) a pixel.
struct Bitmap {
  int width = 0, height = 0;
  std::vector<unsigned char> rgb;
};

}  // namespace palpate
