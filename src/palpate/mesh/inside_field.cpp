#include "palpate/mesh/inside_field.h"

#include <algorithm>
#include <cmath>

#include "palpate/common/cancellation.h"

namespace palpate {
namespace {

// The surface has no boundary, so its winding number is a whole number and errors of 0.2 do not matter.
constexpr double kInsideAccuracy = 1.3;

}  // namespace

InsideField::InsideField(const Surface& capped, double voxels) : winding_(capped, kInsideAccuracy) {
  const Bounds box = boundsOf(capped.vertices);
  const Vec3 extent = (box.high - box.low).cwiseMax(1e-3 * box.diagonal());
  size_ = std::cbrt(extent.prod() / voxels);
  // Two voxels of margin, so that the outer layer is outside for certain.
  low_ = box.low - Vec3::Constant(2 * size_);
  for (size_t d = 0; d < 3; ++d)
    counts_[d] = static_cast<int>(std::ceil(extent[static_cast<Eigen::Index>(d)] / size_)) + 5;
  states_.assign(static_cast<size_t>(counts_[0]) * static_cast<size_t>(counts_[1]) * static_cast<size_t>(counts_[2]),
                 Voxel::unknown);
  markNear(capped);
  flood();
}

void InsideField::markNear(const Surface& surface) {
  for (const auto& t : surface.triangles) {
    throwIfCancelled();
    const Vec3& a = surface.vertices[static_cast<size_t>(t[0])];
    const Vec3& b = surface.vertices[static_cast<size_t>(t[1])];
    const Vec3& c = surface.vertices[static_cast<size_t>(t[2])];
    const Vec3 normal = (b - a).cross(c - a).normalized();
    const double reach = 0.5 * size_ * normal.cwiseAbs().sum() * (1 + 1e-6);
    std::array<int, 3> from{};
    std::array<int, 3> to{};
    for (int d = 0; d < 3; ++d) {
      const auto s = static_cast<size_t>(d);
      const double slack = 1e-6 * size_;
      from[s] = std::clamp(static_cast<int>(std::floor((std::min({a[d], b[d], c[d]}) - slack - low_[d]) / size_)), 0,
                           counts_[s] - 1);
      to[s] = std::clamp(static_cast<int>(std::floor((std::max({a[d], b[d], c[d]}) + slack - low_[d]) / size_)), 0,
                         counts_[s] - 1);
    }
    for (int k = from[2]; k <= to[2]; ++k)
      for (int j = from[1]; j <= to[1]; ++j)
        for (int i = from[0]; i <= to[0]; ++i) {
          const Vec3 center = low_ + size_ * Vec3(i + 0.5, j + 0.5, k + 0.5);
          // A degenerate triangle has no normal: then the whole box of it is near.
          if (!(std::abs(normal.dot(center - a)) > reach)) states_[index(i, j, k)] = Voxel::near;
        }
  }
}

void InsideField::flood() {
  std::vector<size_t> stack;
  const size_t row = static_cast<size_t>(counts_[0]);
  const size_t layer = row * static_cast<size_t>(counts_[1]);
  for (size_t seed = 0; seed < states_.size(); ++seed) {
    if (states_[seed] != Voxel::unknown) continue;
    throwIfCancelled();
    const Vec3 cell(static_cast<double>(seed % row), static_cast<double>(seed % layer / row),
                    static_cast<double>(seed / layer));
    const Vec3 center = low_ + size_ * (cell + Vec3::Constant(0.5));
    // No surface passes between neighbors that are not near, so one winding number serves the whole region.
    const Voxel state = winding_.inside(center) ? Voxel::inside : Voxel::outside;
    states_[seed] = state;
    stack.assign(1, seed);
    while (!stack.empty()) {
      const size_t v = stack.back();
      stack.pop_back();
      const auto visit = [&](bool exists, size_t w) {
        if (!exists || states_[w] != Voxel::unknown) return;
        states_[w] = state;
        stack.push_back(w);
      };
      const size_t i = v % row;
      const size_t j = v % layer / row;
      visit(i > 0, v - 1);
      visit(i + 1 < row, v + 1);
      visit(j > 0, v - row);
      visit(j + 1 < static_cast<size_t>(counts_[1]), v + row);
      visit(v >= layer, v - layer);
      visit(v + layer < states_.size(), v + layer);
    }
  }
}

bool InsideField::inside(const Vec3& x) const {
  std::array<int, 3> c{};
  for (int d = 0; d < 3; ++d) {
    const double q = (x[d] - low_[d]) / size_;
    if (!(q >= 0 && q < counts_[static_cast<size_t>(d)])) return false;
    c[static_cast<size_t>(d)] = static_cast<int>(q);
  }
  const Voxel state = states_[index(c[0], c[1], c[2])];
  return state == Voxel::near ? winding_.inside(x) : state == Voxel::inside;
}

}  // namespace palpate
