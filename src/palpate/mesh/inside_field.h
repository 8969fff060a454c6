#pragma once

#include <cstdint>

#include "palpate/mesh/surface_measures.h"
#include "palpate/mesh/winding_number.h"

namespace palpate {

/// Fast inside test for many points: a voxel grid knows what lies clear of the surface; only points in voxels that the
/// surface may touch ask for the winding number.
class InsideField {
 public:
  /// @param capped  surface without boundary (see capHoles)    @param voxels  about how many voxels to use
  InsideField(const Surface& capped, double voxels = 4e5);

  bool inside(const Vec3& x) const;
  /// Winding number: how many of the solids that overlap hold x.
  double winding(const Vec3& x) const { return winding_.at(x); }
  /// Calls visit(a, b, c) with the corners of each triangle of the surface.
  template <class Visit>
  void forEachTriangle(Visit visit) const {
    winding_.forEachTriangle(visit);
  }

 private:
  enum class Voxel : uint8_t { outside, inside, near, unknown };
  size_t index(int i, int j, int k) const {
    return static_cast<size_t>(i) +
           static_cast<size_t>(counts_[0]) *
               (static_cast<size_t>(j) + static_cast<size_t>(counts_[1]) * static_cast<size_t>(k));
  }
  void markNear(const Surface& surface);
  void flood();

  WindingNumber winding_;
  Vec3 low_;
  double size_ = 1;
  std::array<int, 3> counts_{};
  std::vector<Voxel> states_;
};

}  // namespace palpate
