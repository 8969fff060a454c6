#pragma once

#include <array>
#include <cstdint>

#include "palpate/mesh/types.h"

namespace palpate {

/// Body-centered cubic lattice over a box: cubic cells with a point at each corner and each center. Each square between
/// two cells carries four congruent tetrahedra (the two centers and one edge of the square), so that a cell holds
/// twelve tetrahedra's worth of volume and every dihedral angle is 60 or 90 degrees.
///
/// Points have integer coordinates in half cells: corners even, centers odd.
class BccLattice {
 public:
  using Point = std::array<int, 3>;

  /// @param origin  corner of the box [m]     @param cell  edge of a cell [m]     @param cells  cells a side
  BccLattice(const Vec3& origin, double cell, const std::array<int, 3>& cells)
      : origin_(origin), cell_(cell), cells_(cells) {}

  double cellSize() const { return cell_; }
  const std::array<int, 3>& cells() const { return cells_; }
  const Vec3& origin() const { return origin_; }
  double tetrahedronVolume() const { return cell_ * cell_ * cell_ / 12; }

  /// Tetrahedron `edge` (0 to 3) on the square between cell `lower` and the next cell along `axis`.
  int64_t tetrahedron(const Point& lower, int axis, int edge) const {
    const int64_t c =
        lower[0] + static_cast<int64_t>(cells_[0]) * (lower[1] + static_cast<int64_t>(cells_[1]) * lower[2]);
    return (c * 3 + axis) * 4 + edge;
  }

  /// The cell that it was made from.
  Point lowerCell(int64_t tetrahedron) const { return split(tetrahedron).lower; }

  /// Its four points, positively oriented: lower center, corner, upper center, corner.
  std::array<Point, 4> points(int64_t tetrahedron) const {
    const Split s = split(tetrahedron);
    const size_t d = s.axis;
    const size_t along = s.edge < 2 ? (d + 1) % 3 : (d + 2) % 3;
    const size_t across = s.edge < 2 ? (d + 2) % 3 : (d + 1) % 3;
    std::array<Point, 4> p;
    for (size_t k = 0; k < 3; ++k) p[0][k] = 2 * s.lower[k] + 1;
    p[1] = p[2] = p[3] = p[0];
    p[2][d] += 2;
    for (size_t corner : {size_t{1}, size_t{3}}) {
      p[corner][d] += 1;
      p[corner][along] += side(s.edge);
      p[corner][across] += corner == 1 ? turn(s.edge) : -turn(s.edge);
    }
    return p;
  }

  Vec3 position(const Point& p) const { return origin_ + 0.5 * cell_ * Vec3(p[0], p[1], p[2]); }

  int64_t pointIndex(const Point& p) const {
    return p[0] + static_cast<int64_t>(2 * cells_[0] + 1) * (p[1] + static_cast<int64_t>(2 * cells_[1] + 1) * p[2]);
  }

  /// Tetrahedron that holds x, and x's barycentric coordinates in it; tetrahedron -1 outside the lattice's interior.
  struct Location {
    int64_t tetrahedron = -1;
    Vec4 weights = Vec4::Zero();
  };
  Location locate(const Vec3& x) const {
    const Vec3 q = (x - origin_) / cell_;
    Point c;
    Vec3 g;
    for (int k = 0; k < 3; ++k) {
      if (!(q[k] >= 0 && q[k] < cells_[static_cast<size_t>(k)])) return {};
      c[static_cast<size_t>(k)] = static_cast<int>(q[k]);
      g[k] = q[k] - c[static_cast<size_t>(k)] - 0.5;
    }
    Eigen::Index axis = 0;
    g.cwiseAbs().maxCoeff(&axis);
    const auto d = static_cast<size_t>(axis);
    if (g[axis] < 0) {
      --c[d];
      g[axis] += 1;
    }
    if (c[d] < 0 || c[d] + 1 >= cells_[d]) return {};
    const double gu = g[static_cast<Eigen::Index>((d + 1) % 3)];
    const double gv = g[static_cast<Eigen::Index>((d + 2) % 3)];
    const bool first = std::abs(gu) >= std::abs(gv);
    const int edge = first ? (gu >= 0 ? 0 : 1) : (gv >= 0 ? 2 : 3);
    const double along = side(edge) * (first ? gu : gv);
    const double across = turn(edge) * (first ? gv : gu);
    // On the upper half of the bipyramid the weight of the upper center grows by what the lower one loses.
    const double upper = g[axis] - along;
    return {tetrahedron(c, static_cast<int>(d), edge),
            Vec4(1 - 2 * along - upper, along + across, upper, along - across)};
  }

  /// Barycentric coordinates of any x in a tetrahedron.
  Vec4 weights(int64_t tetrahedron, const Vec3& x) const {
    const Split s = split(tetrahedron);
    const auto d = static_cast<Eigen::Index>(s.axis);
    const Vec3 g = (x - origin_) / cell_ - Vec3(s.lower[0] + 0.5, s.lower[1] + 0.5, s.lower[2] + 0.5);
    const double gu = g[(d + 1) % 3];
    const double gv = g[(d + 2) % 3];
    const double along = side(s.edge) * (s.edge < 2 ? gu : gv);
    const double across = turn(s.edge) * (s.edge < 2 ? gv : gu);
    const double upper = g[d] - along;
    return {1 - 2 * along - upper, along + across, upper, along - across};
  }

 private:
  struct Split {
    Point lower;
    size_t axis;
    int edge;
  };
  Split split(int64_t tetrahedron) const {
    const int64_t c = tetrahedron / 12;
    return {{static_cast<int>(c % cells_[0]), static_cast<int>(c / cells_[0] % cells_[1]),
             static_cast<int>(c / cells_[0] / cells_[1])},
            static_cast<size_t>(tetrahedron / 4 % 3),
            static_cast<int>(tetrahedron % 4)};
  }
  /// Side of the square on which the edge lies, and the direction from its second to its first corner that makes the
  /// tetrahedron positive.
  static int side(int edge) { return edge % 2 == 0 ? 1 : -1; }
  static int turn(int edge) { return edge == 0 || edge == 3 ? 1 : -1; }

  Vec3 origin_;
  double cell_;
  std::array<int, 3> cells_;
};

}  // namespace palpate
