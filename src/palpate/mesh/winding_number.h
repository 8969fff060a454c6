#pragma once

#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// Generalized winding number of an oriented triangle set: about 1 inside a closed outward surface, 0 outside, in
/// between near holes, where it degrades smoothly (Jacobson et al. 2013). Evaluated over a bounding volume hierarchy:
/// far clusters count by the expansion of their solid angle to first order (Barill et al. 2018).
class WindingNumber {
 public:
  /// @param accuracy  a cluster is far at more than this many of its own radii; 2 gives errors below about 0.05, next
  /// to ragged surfaces
  explicit WindingNumber(const Surface& surface, double accuracy = 2.0);

  /// Winding number at x [m].
  double at(const Vec3& x) const;
  bool inside(const Vec3& x) const { return at(x) > 0.5; }
  /// Slow twin of at(): every triangle's solid angle.
  double exactAt(const Vec3& x) const;
  /// Calls visit(a, b, c) with the corners of each triangle.
  template <class Visit>
  void forEachTriangle(Visit visit) const {
    for (const Triangle& t : triangles_) visit(t.a, t.b, t.c);
  }

 private:
  struct Triangle {
    Vec3 a, b, c;
  };
  struct Cluster {
    Vec3 center;  ///< area-weighted
    double far_squared = 0;
    Vec3 area_normal;  ///< sum of area * normal
    Mat3 moment;       ///< sum of (triangle center - center) (area * normal)^T
    int left = -1;     ///< first child; the second is left + 1; -1 for leaves
    int first = 0;     ///< range of triangles
    int last = 0;
  };

  void build(int cluster, double accuracy);
  void summarize(Cluster& cluster, double accuracy) const;
  static double solidAngle(const Triangle& t, const Vec3& x);

  std::vector<Cluster> clusters_;
  std::vector<Triangle> triangles_;  ///< in the order of the leaves
};

}  // namespace palpate
