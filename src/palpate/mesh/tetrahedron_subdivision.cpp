#include "palpate/mesh/tetrahedron_subdivision.h"

#include <algorithm>
#include <map>

namespace palpate {
namespace {

using GridPoint = std::array<int, 3>;

constexpr int kOrders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};

std::array<int, 4> barycentric(const GridPoint& c, int m) { return {m - c[0], c[0] - c[1], c[1] - c[2], c[2]}; }

bool insideCoarse(const GridPoint& c, int m) {
  const auto b = barycentric(c, m);
  return *std::min_element(b.begin(), b.end()) >= 0;
}

/// Rank in `orders` of the axes sorted by descending fraction.
int orderOf(const Vec3& fraction) {
  std::array<int, 3> axes = {0, 1, 2};
  std::stable_sort(axes.begin(), axes.end(), [&](int a, int b) { return fraction[a] > fraction[b]; });
  for (int o = 0; o < 6; ++o)
    if (kOrders[o][0] == axes[0] && kOrders[o][1] == axes[1]) return o;
  return 0;
}

}  // namespace

TetrahedronSubdivision::TetrahedronSubdivision(int m) : m_(m), part_of_(static_cast<size_t>(6 * m * m * m), -1) {
  std::map<std::array<GridPoint, 3>, int> open;
  for (int cube = 0; cube < m * m * m; ++cube) {
    const GridPoint base = {cube % m, cube / m % m, cube / m / m};
    for (int o = 0; o < 6; ++o) {
      std::array<GridPoint, 4> corners;
      corners[0] = base;
      for (size_t s = 0; s < 3; ++s) {
        corners[s + 1] = corners[s];
        ++corners[s + 1][static_cast<size_t>(kOrders[o][s])];
      }
      if (!std::all_of(corners.begin(), corners.end(), [&](const GridPoint& c) { return insideCoarse(c, m); }))
        continue;
      const int part = count();
      part_of_[static_cast<size_t>(6 * cube + o)] = part;
      Vec4 center = Vec4::Zero();
      for (const GridPoint& c : corners)
        for (size_t k = 0; k < 4; ++k) center[static_cast<Eigen::Index>(k)] += barycentric(c, m)[k] / (4.0 * m);
      centers_.push_back(center);
      for (size_t skip = 0; skip < 4; ++skip) {
        std::array<GridPoint, 3> key;
        for (size_t s = 0, n = 0; s < 4; ++s)
          if (s != skip) key[n++] = corners[s];
        std::sort(key.begin(), key.end());
        const auto [it, fresh] = open.try_emplace(key, part);
        if (fresh) continue;
        neighbors_.push_back({it->second, part});
        open.erase(it);
      }
    }
  }
  for (const auto& [key, part] : open) {
    std::array<int, 4> sum{};
    for (const GridPoint& c : key)
      for (size_t k = 0; k < 4; ++k) sum[k] += barycentric(c, m)[k];
    for (size_t k = 0; k < 4; ++k)
      if (sum[k] == 0) faces_[k].push_back({part, sum});
  }
}

int TetrahedronSubdivision::locate(const Vec4& weights) const {
  const Vec3 x(m_ * (weights[1] + weights[2] + weights[3]), m_ * (weights[2] + weights[3]), m_ * weights[3]);
  GridPoint cube{};
  Vec3 fraction;
  for (size_t k = 0; k < 3; ++k) {
    const auto e = static_cast<Eigen::Index>(k);
    cube[k] = std::clamp(static_cast<int>(x[e]), 0, m_ - 1);
    fraction[e] = x[e] - cube[k];
  }
  const int index = cube[0] + m_ * (cube[1] + m_ * cube[2]);
  const int part = part_of_[static_cast<size_t>(6 * index + orderOf(fraction))];
  if (part >= 0) return part;
  // Rounding pushed the point out of the coarse tetrahedron: take the nearest center.
  int best = 0;
  for (int i = 1; i < count(); ++i)
    if ((centers_[static_cast<size_t>(i)] - weights).squaredNorm() <
        (centers_[static_cast<size_t>(best)] - weights).squaredNorm())
      best = i;
  return best;
}

}  // namespace palpate
