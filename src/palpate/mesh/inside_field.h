#pragma once

#include <cstdint>

#include "palpate/mesh/surface_measures.h"
#include "palpate/mesh/winding_number.h"

namespace palpate {

/// Fast inside test for many points: a voxel grid knows what lies clear of the surface; only points in voxels that the
/// surface may touch ask for the winding number.
class InsideField {
 public:
  enum class Voxel : uint8_t { outside, inside, near, unknown };

  /// @param capped  surface without boundary (see capHoles)    @param voxels  about how many voxels to use
  InsideField(const Surface& capped, double voxels = 4e5);

  bool inside(const Vec3& x) const;
  /// Winding number: how many of the solids that overlap hold x.
  double winding(const Vec3& x) const { return winding_.at(x); }

  double voxelSize() const { return size_; }
  const std::array<int, 3>& counts() const { return counts_; }
  const Vec3& low() const { return low_; }
  Voxel voxel(int i, int j, int k) const { return states_[index(i, j, k)]; }

 private:
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
