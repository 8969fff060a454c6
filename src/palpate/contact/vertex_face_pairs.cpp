#include <algorithm>
#include <cmath>

#include "palpate/contact/feature_tests.h"
#include "palpate/math/stable_norm.h"

namespace palpate {

Vec3 unitOr(const Vec3& v, const Vec3& other) {
  const double n = stableNorm(v);
  if (n > 0) return v / n;
  const double m = stableNorm(other);
  return m > 0 ? Vec3(other / m) : Vec3(Vec3::UnitZ());
}

TrianglePoint VertexFaces::closest(int v, int face, double t) const {
  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  return closestOnTriangle(sv.position(v, t), sf.position(f[0], t), sf.position(f[1], t), sf.position(f[2], t));
}

double VertexFaces::travel(int v, int face) const {
  const Vec3 dv = displacement(sv, v);
  double l2 = 0;
  for (const int w : sf.triangles()[static_cast<size_t>(face)])
    l2 = std::max(l2, (dv - displacement(sf, w)).squaredNorm());
  return std::sqrt(l2);
}

bool VertexFaces::apart(int v, int face, const TrianglePoint& q) const {
  if (!(q.distance > s.reach)) return false;
  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  Vec3 n = at(sv.start, v);
  for (size_t i = 0; i < 3; ++i) n -= q.weight[i] * at(sf.start, f[i]);
  const auto gap = [&](double t) {
    return n.dot(sv.position(v, t)) -
           std::max({n.dot(sf.position(f[0], t)), n.dot(sf.position(f[1], t)), n.dot(sf.position(f[2], t))});
  };
  return std::min(gap(0), gap(s.to)) > kClear * s.reach * q.distance;
}

// Touching at the start: a hit unless the end is clear of the face's plane.
Approach VertexFaces::leaving(int v, int face, const TrianglePoint& q) const {
  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  const Vec3 n = faceNormal(face);
  double end_gap = n.dot(at(sv.end, v));
  for (size_t i = 0; i < 3; ++i) end_gap -= q.weight[i] * n.dot(at(sf.end, f[i]));
  return end_gap > 0 ? Approach{1, false} : Approach{0, true};
}

Approach VertexFaces::impact(int v, int face, const TrianglePoint& q, double travel, double until) const {
  if (touching(q.distance, at(sv.start, v))) return leaving(v, face, q);
  const double least = s.hitDistance(q.distance);
  if (!(q.distance - travel < least)) return {1, false};
  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  return timeOfApproach(
      FeatureKind::vertex_face, {at(sv.start, v), at(sf.start, f[0]), at(sf.start, f[1]), at(sf.start, f[2])},
      {at(sv.end, v), at(sf.end, f[0]), at(sf.end, f[1]), at(sf.end, f[2])}, least, s.settings.max_iterations, until);
}

Approach VertexFaces::impact(int v, int face, double until) const {
  return impact(v, face, closest(v, face, 0), travel(v, face), until);
}

// Calls visit(other face) for the other faces at the edge or corner where q is, until it returns true.
template <class Visit>
bool VertexFaces::anyNeighbor(int face, const TrianglePoint& q, Visit visit) const {
  int inside = 0, last = 0;
  for (int i = 0; i < 3; ++i)
    if (q.weight[static_cast<size_t>(i)] > kOutline) {
      ++inside;
      last = i;
    }
  if (inside == 3) return false;
  if (inside == 1) {
    for (const int f : sf.trianglesAtVertex(sf.triangles()[static_cast<size_t>(face)][static_cast<size_t>(last)]))
      if (f != face && visit(f)) return true;
    return false;
  }
  int edge = 0;  // opposite the corner without weight: from the next corner on
  for (int i = 0; i < 3; ++i)
    if (!(q.weight[static_cast<size_t>(i)] > kOutline)) edge = (i + 1) % 3;
  const int e = sf.triangleEdges()[static_cast<size_t>(face)][static_cast<size_t>(edge)];
  for (const int f : sf.edgeTriangles()[static_cast<size_t>(e)])
    if (f >= 0 && f != face && visit(f)) return true;
  return false;
}

// Another face at the same edge or corner is nearer at time t, or as near and lower.
bool VertexFaces::neighborNearer(int v, int face, const TrianglePoint& q, double t) const {
  return anyNeighbor(face, q, [&](int f) {
    if (excluded(v, f)) return false;
    const double d = closest(v, f, t).distance;
    return d < q.distance || (d == q.distance && f < face);
  });
}

// The line at time t enters one of the surfaces beside the vertex, or beside where it meets the face.
bool VertexFaces::askew(int v, int face, const TrianglePoint& q, double t) const {
  const double square = std::sqrt(1 - kAskew * kAskew);
  return besideEdge(v, face, q, t, kAskew) || anyNeighbor(face, q, [&](int f) {
           return !excluded(v, f) && closest(v, f, t).distance < square * q.distance;
         });
}

bool VertexFaces::neighborHitFirst(int v, int face, const TrianglePoint& q, double toi) const {
  return anyNeighbor(face, q, [&](int f) {
    if (excluded(v, f)) return false;
    const Approach other = impact(v, f, toi);
    return other.reached && (other.time < toi || (other.time == toi && f < face));
  });
}

// The nearest point is on the face's outline, and a face at the vertex is nearer to it than the vertex is: then this is
// a vertex beside an edge, and the edge's own pairs say more.
bool VertexFaces::besideEdge(int v, int face, const TrianglePoint& q, double t, double least) const {
  if (std::min({q.weight[0], q.weight[1], q.weight[2]}) > kOutline) return false;
  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  const Vec3 x = sv.position(v, t);
  Vec3 line = -x;
  for (size_t i = 0; i < 3; ++i) line += q.weight[i] * sf.position(f[i], t);
  for (const int g : sv.trianglesAtVertex(v))
    for (const int w : sv.triangles()[static_cast<size_t>(g)]) {
      const Vec3 along = sv.position(w, t) - x;
      if (w != v && line.dot(along) > least * line.norm() * along.norm()) return true;
    }
  return false;
}

bool VertexFaces::nearest(int v, int face, const TrianglePoint& q, double t) const {
  return !neighborNearer(v, face, q, t) && !besideEdge(v, face, q, t);
}

bool VertexFaces::chooseTime(int v, int face, const TrianglePoint& at_end, TrianglePoint& q, FeaturePair& pair) const {
  if (pair.hit) {
    pair.reference_time = pair.toi;
    q = closest(v, face, pair.toi);
    return !(s.settings.ahead && askew(v, face, q, pair.toi)) && !neighborHitFirst(v, face, q, pair.toi);
  }
  if (pair.start_distance < s.reach && nearest(v, face, q, 0)) {
    pair.reference_time = 0;
    return true;
  }
  pair.reference_time = 1;
  q = at_end;
  return pair.end_distance < s.reach && nearest(v, face, q, 1);
}

// Vertex v is nearest to a vertex w, and w to v: one of the two pairs is enough, and this one is the other.
bool VertexFaces::doubled(int v, int face, const TrianglePoint& q, double t, bool vertex_first) const {
  int corner = -1;
  for (size_t i = 0; i < 3; ++i)
    if (q.weight[i] > 1 - kOutline) corner = sf.triangles()[static_cast<size_t>(face)][i];
  if (corner < 0 || (s.self() ? v < corner : vertex_first)) return false;
  const VertexFaces back{s, sf, sv};
  for (const int f : sv.trianglesAtVertex(v)) {
    if (back.excluded(corner, f)) return false;
    if (back.closest(corner, f, t).distance < q.distance * (1 - 1e-9)) return false;
  }
  return true;
}

// Normal (from face to vertex), sides and further distances at the reference time.
void VertexFaces::describe(int v, int face, const TrianglePoint& q, FeaturePair& pair) const {
  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  const double t = pair.reference_time;
  Vec3 line = sv.position(v, t), line_end = at(sv.end, v);
  const bool clear = !touching(q.distance, line);
  for (size_t i = 0; i < 3; ++i) {
    line -= q.weight[i] * sf.position(f[i], t);
    line_end -= q.weight[i] * at(sf.end, f[i]);
  }
  pair.normal = clear ? unitOr(line, Vec3::UnitZ()) : faceNormal(face);
  if (pair.hit) pair.end_distance = pair.normal.dot(line_end);
  if (s.self()) {
    const auto& rest = sv.rest();
    const double d = closestOnTriangle(at(rest, v), at(rest, f[0]), at(rest, f[1]), at(rest, f[2])).distance;
    if (d < s.reach) pair.rest_distance = d;
  }
  const Vec3 out = sv.cornerNormal(v, t);
  pair.from_inside =
      pair.normal.dot(sf.outwardNormal(face, q.weight, t)) < 0 || pair.normal.dot(out) > kEntering * out.norm();
}

namespace {

// One side of a pair.
struct Side {
  std::array<int, 3> vertex;
  std::array<double, 3> weight;
  int triangle, feature;
};

void setSides(FeaturePair& pair, const Side& first, const Side& second) {
  pair.first_vertex = first.vertex;
  pair.second_vertex = second.vertex;
  pair.first_weight = first.weight;
  pair.second_weight = second.weight;
  pair.first_triangle = first.triangle;
  pair.second_triangle = second.triangle;
  pair.first_feature = first.feature;
  pair.second_feature = second.feature;
}

}  // namespace

bool isNearestVertexFace(const PairSearch& s, bool vertex_first, int vertex, int face) {
  const VertexFaces faces{s, vertex_first ? s.a : s.b, vertex_first ? s.b : s.a};
  return faces.nearest(vertex, face, faces.closest(vertex, face, 0), 0);
}

void testVertexFace(PairSearch& s, bool vertex_first, int vertex, int owner, int face) {
  const VertexFaces faces{s, vertex_first ? s.a : s.b, vertex_first ? s.b : s.a};
  if (s.may_exclude && faces.excluded(vertex, face)) return;
  TrianglePoint q = faces.closest(vertex, face, 0);
  s.noteDistance(q.distance);
  if (q.distance < s.reach && s.from > 0) return;
  if (faces.apart(vertex, face, q)) return;
  const double travel = faces.travel(vertex, face);
  if (q.distance - s.to * travel > s.reach) return;

  FeaturePair pair;
  pair.start_distance = q.distance;
  const bool now = s.settings.as_now && q.distance < s.reach && faces.nearest(vertex, face, q, 0);
  const Approach impact = now ? Approach{1, false} : faces.impact(vertex, face, q, travel, s.horizon(q.distance));
  if (!impact.reached && s.onlyHits(q.distance)) return;
  pair.hit = impact.reached;
  pair.toi = pair.hit ? impact.time : 1;
  const TrianglePoint at_end = faces.closest(vertex, face, 1);
  pair.end_distance = at_end.distance;
  if (!s.wanted(pair) || !faces.chooseTime(vertex, face, at_end, q, pair)) return;
  if (faces.doubled(vertex, face, q, pair.reference_time, vertex_first)) return;

  faces.describe(vertex, face, q, pair);
  const Side corner{{vertex, -1, -1}, {1, 0, 0}, owner, vertex};
  const Side on_face{faces.sf.triangles()[static_cast<size_t>(face)], q.weight, face, face};
  if (vertex_first) {
    pair.kind = FeaturePair::Kind::vertex_face;
    setSides(pair, corner, on_face);
  } else {
    pair.kind = FeaturePair::Kind::face_vertex;
    pair.normal = Vec3(-pair.normal);
    setSides(pair, on_face, corner);
  }
  s.report(pair);
}

}  // namespace palpate
