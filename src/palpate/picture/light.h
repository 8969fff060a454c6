#pragma once

#include <Eigen/Core>
#include <vector>

#include "palpate/picture/smooth_mesh.h"

namespace palpate {

/// What the light does at a point of a surface, before the surface's own color.
struct Illumination {
  Eigen::Vector3f light = Eigen::Vector3f::Zero();  ///< diffuse, all lamps [1 is white]
  float key = 0;                                    ///< share of the main lamp that reaches the point
  float open = 0;                                   ///< share of the sky that does
};

/// How far what casts shadows reaches towards a lamp: an orthographic depth image.
class DepthMap {
 public:
  /// @param towards  the lamp, unit
  /// @param radius   of the ball about the origin that the map covers [m]
  DepthMap(const Eigen::Vector3f& towards, float radius, int size);
  void draw(const SmoothMesh& mesh);
  /// Share of light that reaches x, 0 to 1; between pixels the four nearest are weighted. Outside of the map: 1.
  float visibility(const Eigen::Vector3f& x) const;
  const Eigen::Vector3f& towards() const { return w_; }

 private:
  Eigen::Vector3f u_, v_, w_;
  float scale_, offset_, bias_;
  int size_;
  std::vector<float> depth_;
};

/// A studio: a large main lamp from the left and above, a weak fill from the right, a rim from behind, and a sky. Main
/// lamp and sky are many small lamps with a depth map each, hence soft shadows, also where a body rests on the ground.
class Studio {
 public:
  /// @param casters  cast shadows
  /// @param radius   of the ball about the origin in which they do [m]
  /// @param right, forward  of the camera; unit
  Studio(const std::vector<const SmoothMesh*>& casters, float radius, const Eigen::Vector3f& right,
         const Eigen::Vector3f& forward);

  /// @param shift  the point at which shadows are looked up lies this far along the normal, so that a surface does not
  ///               shade itself [m]
  Illumination at(const Eigen::Vector3f& x, const Eigen::Vector3f& normal, float shift) const;
  /// The same where nothing is in the way.
  Illumination open(const Eigen::Vector3f& normal) const;

  const Eigen::Vector3f& keyDirection() const { return key_direction_; }
  float texel() const { return texel_; }  ///< of the coarsest map [m]

 private:
  template <class Visibility>
  Illumination sum(const Eigen::Vector3f& normal, const Visibility& visibility) const;

  std::vector<DepthMap> maps_;  // main lamp, then sky
  std::size_t keys_ = 0;
  float texel_ = 0;
  Eigen::Vector3f key_direction_, fill_direction_, rim_direction_;
};

}  // namespace palpate
