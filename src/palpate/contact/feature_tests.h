#pragma once

#include <array>

#include "palpate/contact/feature_distance.h"
#include "palpate/contact/pair_search.h"

namespace palpate {

/// What the tests of vertices against faces and of edges against edges share. For the parts of SurfacePairFinder only.

constexpr double kOutline = CollisionSurface::kOutline;
/// Sine by which a line must enter a solid at a vertex or edge that is not nearest to it.
constexpr double kEntering = 0.2;
/// Sine of the angle below which a face is square to the shortest line.
constexpr double kFlat = 1e-6;
/// Sine by which the line of a hit, looked for ahead, must enter a face beside it to tell nothing of a surface.
constexpr double kAskew = 0.3;

/// What a gap must exceed the reach by, so that rounding does not matter.
constexpr double kClear = 1 + 1e-6;

inline const Vec3& at(const std::vector<Vec3>& points, int i) { return points[static_cast<size_t>(i)]; }
inline Vec3 displacement(const CollisionSurface& s, int v) { return at(s.end, v) - at(s.start, v); }

/// Distance so small that the line between the points has no meaning.
inline bool touching(double distance, const Vec3& p) { return distance <= 1e-13 + 1e-12 * p.cwiseAbs().maxCoeff(); }

/// v / |v|; where that is nothing, the other's direction, or z.
Vec3 unitOr(const Vec3& v, const Vec3& other);

/// A vertex of surface `sv` against faces of `sf` (the other one, or the same), within one search.
struct VertexFaces {
  const PairSearch& s;
  const CollisionSurface& sv;
  const CollisionSurface& sf;

  bool excluded(int v, int face) const {
    const std::array<int, 3> vertex{v, -1, -1};
    const auto& f = sf.triangles()[static_cast<size_t>(face)];
    return &sv == &s.a ? s.excluded(vertex, f) : s.excluded(f, vertex);
  }
  TrianglePoint closest(int v, int face, double t) const;
  /// Bound of how far the vertex moves relative to any point of the face.
  double travel(int v, int face) const;
  /// A plane square to the shortest line at the start keeps them farther apart than the reach, on the way to the end of
  /// the present piece of time.
  bool apart(int v, int face, const TrianglePoint& q) const;
  Vec3 faceNormal(int face) const { return unitOr(sf.areaNormal(face, 0), Vec3::UnitZ()); }
  /// When the vertex hits the face, if it does by then.
  /// @param q  closest point at the start
  Approach impact(int v, int face, const TrianglePoint& q, double travel, double until) const;
  Approach impact(int v, int face, double until = 1) const;
  /// Sets the time at which the pair is described, and q, from the closest point at the start to that then; false if
  /// other pairs say the same.
  bool chooseTime(int v, int face, const TrianglePoint& at_end, TrianglePoint& q, FeaturePair& pair) const;
  bool doubled(int v, int face, const TrianglePoint& q, double t, bool vertex_first) const;
  void describe(int v, int face, const TrianglePoint& q, FeaturePair& pair) const;
  /// Worth a pair at time t, which is not an impact.
  bool nearest(int v, int face, const TrianglePoint& q, double t) const;

 private:
  Approach leaving(int v, int face, const TrianglePoint& q) const;
  template <class Visit>
  bool anyNeighbor(int face, const TrianglePoint& q, Visit visit) const;
  bool neighborNearer(int v, int face, const TrianglePoint& q, double t) const;
  bool neighborHitFirst(int v, int face, const TrianglePoint& q, double toi) const;
  bool besideEdge(int v, int face, const TrianglePoint& q, double t, double least = kFlat) const;
  bool askew(int v, int face, const TrianglePoint& q, double t) const;
};

}  // namespace palpate
