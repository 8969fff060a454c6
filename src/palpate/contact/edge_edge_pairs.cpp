#include <algorithm>
#include <cmath>

#include "palpate/contact/feature_tests.h"

namespace palpate {
namespace {

constexpr double kNearlySquare = 0.1;  // sine of the angle by which a flat face may soon turn

// How an edge's faces lie to the shortest line that leaves it along `outward` (unit).
struct EdgeFaces {
  bool nearer = false;  // a face at the edge comes nearer than the edge
  bool flat = false;    // two faces, both square to the line
};
EdgeFaces edgeFaces(const CollisionSurface& s, int edge, double t, const Vec3& outward, double nearly_square = kFlat) {
  EdgeFaces result;
  int faces = 0, square = 0;
  for (const int f : s.edgeTriangles()[static_cast<size_t>(edge)]) {
    if (f < 0) continue;
    ++faces;
    const Vec3 inward = s.inward(edge, f, t);
    const double rise = inward.dot(outward), size = inward.norm();
    if (rise > nearly_square * size) result.nearer = true;
    if (std::abs(rise) <= kFlat * size) ++square;
  }
  result.flat = faces == 2 && square == 2;
  return result;
}

// Both nearest points are inside their edges.
bool inside(const SegmentPair& p) {
  return p.s > kOutline && p.s < 1 - kOutline && p.t > kOutline && p.t < 1 - kOutline;
}

// Whether vertex v hits a face at an edge of the other surface.
bool vertexHits(const VertexFaces& faces, int v, int edge) {
  for (const int f : faces.sf.edgeTriangles()[static_cast<size_t>(edge)])
    if (f >= 0 && !faces.excluded(v, f) && faces.impact(v, f).reached) return true;
  return false;
}

// An edge of s.a against one of s.b.
struct EdgeEdge {
  const PairSearch& s;
  int edge_a, edge_b;
  const std::array<int, 2>& a = s.a.edges()[static_cast<size_t>(edge_a)];
  const std::array<int, 2>& b = s.b.edges()[static_cast<size_t>(edge_b)];

  SegmentPair closest(double t) const {
    return closestOnSegments(s.a.position(a[0], t), s.a.position(a[1], t), s.b.position(b[0], t),
                             s.b.position(b[1], t));
  }
  // Bound of how far any point of one edge moves relative to any of the other.
  double travel() const {
    double travel2 = 0;
    for (const int v : a)
      for (const int w : b) travel2 = std::max(travel2, (displacement(s.a, v) - displacement(s.b, w)).squaredNorm());
    return std::sqrt(travel2);
  }
  // From the second edge's point to the first one's.
  Vec3 line(const SegmentPair& p, double t) const {
    return Vec3((1 - p.s) * s.a.position(a[0], t) + p.s * s.a.position(a[1], t) - (1 - p.t) * s.b.position(b[0], t) -
                p.t * s.b.position(b[1], t));
  }
  // A plane square to the shortest line at the start keeps them farther apart than the reach, on the way to the end of
  // the present piece of time.
  bool apart(const SegmentPair& q) const {
    if (!(q.distance > s.reach)) return false;
    const Vec3 n = line(q, 0);
    const auto gap = [&](double t) {
      return std::min(n.dot(s.a.position(a[0], t)), n.dot(s.a.position(a[1], t))) -
             std::max(n.dot(s.b.position(b[0], t)), n.dot(s.b.position(b[1], t)));
    };
    return std::min(gap(0), gap(s.to)) > kClear * s.reach * q.distance;
  }
  Vec3 normal(const SegmentPair& p, double t) const;
  Approach impact(const SegmentPair& q, double travel, double until) const;
  bool chooseTime(const SegmentPair& at_end, SegmentPair& q, FeaturePair& pair) const;
  void describe(const SegmentPair& q, FeaturePair& pair) const;
  bool standsOut(const SegmentPair& p, double t) const;
  bool askew(const SegmentPair& p, double t) const;

 private:
  Vec3 touchingNormal(double t) const;
  bool redundantHit(const SegmentPair& p, double t) const;
};

// Out of both surfaces' faces where the edges touch; square to both edges where they have a common normal.
Vec3 EdgeEdge::touchingNormal(double t) const {
  const Vec3 out = s.b.edgeNormal(edge_b, t) - s.a.edgeNormal(edge_a, t);
  const Vec3 da = s.a.position(a[1], t) - s.a.position(a[0], t);
  const Vec3 db = s.b.position(b[1], t) - s.b.position(b[0], t);
  const Vec3 across = da.cross(db);
  if (!(across.norm() > 1e-6 * da.norm() * db.norm())) return unitOr(out, Vec3::UnitZ());
  return unitOr(across.dot(out) < 0 ? Vec3(-across) : across, out);
}

Vec3 EdgeEdge::normal(const SegmentPair& p, double t) const {
  if (touching(p.distance, s.a.position(a[0], t))) return touchingNormal(t);
  return unitOr(line(p, t), Vec3::UnitZ());
}

// When the edges hit each other, if they do by then; q: closest points at the start. Edges that touch at the start hit
// unless the end is clear.
Approach EdgeEdge::impact(const SegmentPair& q, double travel, double until) const {
  if (touching(q.distance, at(s.a.start, a[0])))
    return touchingNormal(0).dot(line(q, 1)) > 0 ? Approach{1, false} : Approach{0, true};
  const double least = s.hitDistance(q.distance);
  if (!(q.distance - travel < least)) return {1, false};
  return timeOfApproach(FeatureKind::edge_edge,
                        {at(s.a.start, a[0]), at(s.a.start, a[1]), at(s.b.start, b[0]), at(s.b.start, b[1])},
                        {at(s.a.end, a[0]), at(s.a.end, a[1]), at(s.b.end, b[0]), at(s.b.end, b[1])}, least,
                        s.settings.max_iterations, until);
}

// Worth a contact of its own at time t, which is not an impact.
bool EdgeEdge::standsOut(const SegmentPair& p, double t) const {
  if (!inside(p)) return false;
  const Vec3 n = normal(p, t);
  const double square = s.settings.as_now ? kNearlySquare : kFlat;
  const EdgeFaces fa = edgeFaces(s.a, edge_a, t, -n, square), fb = edgeFaces(s.b, edge_b, t, n, square);
  return !fa.nearer && !fb.nearer && !fa.flat && !fb.flat;
}

// The line at time t enters one of the surfaces beside its edge.
bool EdgeEdge::askew(const SegmentPair& p, double t) const {
  const Vec3 n = normal(p, t);
  return edgeFaces(s.a, edge_a, t, -n, kAskew).nearer || edgeFaces(s.b, edge_b, t, n, kAskew).nearer;
}

// A hit that others stand for.
bool EdgeEdge::redundantHit(const SegmentPair& p, double t) const {
  const VertexFaces a_on_b{s, s.a, s.b}, b_on_a{s, s.b, s.a};
  if (p.s <= kOutline && vertexHits(a_on_b, a[0], edge_b)) return true;
  if (p.s >= 1 - kOutline && vertexHits(a_on_b, a[1], edge_b)) return true;
  if (p.t <= kOutline && vertexHits(b_on_a, b[0], edge_a)) return true;
  if (p.t >= 1 - kOutline && vertexHits(b_on_a, b[1], edge_a)) return true;
  if (!inside(p)) return false;
  const Vec3 n = normal(p, t);
  return edgeFaces(s.a, edge_a, t, -n).flat || edgeFaces(s.b, edge_b, t, n).flat;
}

// Sets the time at which the pair is described, and q, from the closest points at the start to those then; false if
// other pairs say the same.
bool EdgeEdge::chooseTime(const SegmentPair& at_end, SegmentPair& q, FeaturePair& pair) const {
  if (pair.hit) {
    pair.reference_time = pair.toi;
    q = closest(pair.toi);
    return !(s.settings.ahead && askew(q, pair.toi)) && !redundantHit(q, pair.toi);
  }
  if (pair.start_distance < s.reach && standsOut(q, 0)) {
    pair.reference_time = 0;
    return true;
  }
  pair.reference_time = 1;
  q = at_end;
  return pair.end_distance < s.reach && standsOut(q, 1);
}

void EdgeEdge::describe(const SegmentPair& q, FeaturePair& pair) const {
  const double t = pair.reference_time;
  pair.kind = FeaturePair::Kind::edge_edge;
  pair.normal = normal(q, t);
  if (pair.hit) pair.end_distance = pair.normal.dot(line(q, 1));
  const Vec3 out_a = s.a.edgeNormal(edge_a, t), out_b = s.b.edgeNormal(edge_b, t);
  pair.from_inside =
      -pair.normal.dot(out_b) > kEntering * out_b.norm() || pair.normal.dot(out_a) > kEntering * out_a.norm();
  if (s.self()) {
    const auto& rest = s.a.rest();
    const double d = closestOnSegments(at(rest, a[0]), at(rest, a[1]), at(rest, b[0]), at(rest, b[1])).distance;
    if (d < s.reach) pair.rest_distance = d;
  }
  pair.first_vertex = {a[0], a[1], -1};
  pair.second_vertex = {b[0], b[1], -1};
  pair.first_weight = {1 - q.s, q.s, 0};
  pair.second_weight = {1 - q.t, q.t, 0};
  pair.first_feature = edge_a;
  pair.second_feature = edge_b;
  pair.first_triangle = s.a.ownerOfEdge(edge_a);
  pair.second_triangle = s.b.ownerOfEdge(edge_b);
}

}  // namespace

bool isNearestEdgeEdge(const PairSearch& s, int edge_a, int edge_b) {
  const EdgeEdge edges{s, edge_a, edge_b};
  return edges.standsOut(edges.closest(0), 0);
}

void testEdgeEdge(PairSearch& s, int edge_a, int edge_b) {
  const EdgeEdge edges{s, edge_a, edge_b};
  if (s.may_exclude && s.excluded({edges.a[0], edges.a[1], -1}, {edges.b[0], edges.b[1], -1})) return;
  SegmentPair q = edges.closest(0);
  s.noteDistance(q.distance);
  if (q.distance < s.reach && s.from > 0) return;
  if (edges.apart(q)) return;
  const double travel = edges.travel();
  if (q.distance - s.to * travel > s.reach) return;

  FeaturePair pair;
  pair.start_distance = q.distance;
  // all that a hollow edge can be is hit
  const bool hollow = s.a.hollow(edge_a) || s.b.hollow(edge_b);
  const bool now = s.settings.as_now && !hollow && q.distance < s.reach && edges.standsOut(q, 0);
  const Approach impact = now ? Approach{1, false} : edges.impact(q, travel, s.horizon(q.distance));
  if (!impact.reached && (s.onlyHits(q.distance) || hollow)) return;
  pair.hit = impact.reached;
  pair.toi = pair.hit ? impact.time : 1;
  const SegmentPair at_end = edges.closest(1);
  pair.end_distance = at_end.distance;
  if (!s.wanted(pair) || !edges.chooseTime(at_end, q, pair)) return;
  edges.describe(q, pair);
  s.report(pair);
}

}  // namespace palpate
