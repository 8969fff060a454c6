#include "palpate/contact/overlap.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "palpate/contact/feature_distance.h"
#include "palpate/contact/meeting_clusters.h"

namespace palpate {
namespace {

constexpr double kDoubt = 1e-9;  // relative closeness of a ray to an edge that calls for another ray

const Vec3& at(const std::vector<Vec3>& points, int i) { return points[static_cast<size_t>(i)]; }

struct Corners {
  const Vec3 &a, &b, &c;
};
Corners cornersOf(const CollisionSurface& s, int triangle) {
  const auto& t = s.triangles()[static_cast<size_t>(triangle)];
  return {at(s.start, t[0]), at(s.start, t[1]), at(s.start, t[2])};
}

struct Range {
  Vec3 low, high;
};
Range startRange(const MovingBox& box) {
  return {box.start_low.head<3>().cast<double>(), -box.start_negative_high.head<3>().cast<double>()};
}

bool contains(const MovingBox& box, const Vec3& p) {
  const Range r = startRange(box);
  return (p.array() >= r.low.array()).all() && (p.array() <= r.high.array()).all();
}

double squaredDistance(const MovingBox& box, const Vec3& p) {
  const Range r = startRange(box);
  return (r.low - p).cwiseMax(p - r.high).cwiseMax(0).squaredNorm();
}

bool rayMeets(const MovingBox& box, const Vec3& origin, const Vec3& inverse) {
  const Range r = startRange(box);
  const Vec3 x = (r.low - origin).cwiseProduct(inverse), y = (r.high - origin).cwiseProduct(inverse);
  return std::max(0.0, x.cwiseMin(y).maxCoeff()) <= x.cwiseMax(y).minCoeff();
}

// 1: the ray crosses the triangle, 0: it does not, nothing: too close to tell.
std::optional<int> crossing(const Corners& t, const Vec3& origin, const Vec3& direction) {
  const Vec3 u = t.b - t.a, v = t.c - t.a, w = origin - t.a;
  const Vec3 n = u.cross(v);
  const double area = n.norm(), det = -direction.dot(n);
  const double longest = std::sqrt(std::max({u.squaredNorm(), v.squaredNorm(), (t.c - t.b).squaredNorm()}));
  if (!(area > 1e-12 * longest * longest)) return std::nullopt;  // a needle: the ray is near an edge
  const double height = w.dot(n);                                // over the plane, times area
  if (std::abs(det) < kDoubt * area) {
    if (std::abs(height) > 1e-6 * area * (longest + w.norm())) return 0;
    return std::nullopt;
  }
  const Vec3 q = w.cross(direction);
  const double wb = v.dot(q) / det, wc = -u.dot(q) / det, wa = 1 - wb - wc;
  const double least = std::min({wa, wb, wc});
  const double doubt = kDoubt * (1 + w.norm() / longest);
  if (least < -doubt) return 0;
  if (std::abs(height) <= 1e-14 * area * (longest + origin.norm())) return std::nullopt;
  if ((height > 0) != (det > 0)) return 0;  // behind
  if (least < doubt) return std::nullopt;
  return 1;
}

std::optional<bool> insideByRay(const CollisionSurface& s, const Vec3& p, const Vec3& direction) {
  const Vec3 inverse = direction.cwiseInverse();
  int crossings = 0;
  const auto& nodes = s.nodes();
  std::array<int, 64> stack;  // the tree is balanced: its depth is the logarithm of the number of clusters
  int size = 0;
  stack[static_cast<size_t>(size++)] = 0;
  while (size > 0) {
    const int i = stack[static_cast<size_t>(--size)];
    if (!rayMeets(s.nodeBox(i), p, inverse)) continue;
    const auto& node = nodes[static_cast<size_t>(i)];
    if (node.right >= 0) {
      stack[static_cast<size_t>(size++)] = i + 1;
      stack[static_cast<size_t>(size++)] = node.right;
      continue;
    }
    const auto boxes = s.triangleBoxes(node.cluster);
    const auto triangles = s.trianglesOfCluster(node.cluster);
    for (size_t k = 0; k < boxes.size(); ++k) {
      if (!rayMeets(boxes[k], p, inverse)) continue;
      const auto one = crossing(cornersOf(s, triangles[k]), p, direction);
      if (!one) return std::nullopt;
      crossings += *one;
    }
  }
  return crossings % 2 == 1;
}

bool insideByWinding(const CollisionSurface& s, const Vec3& p) {
  double sum = 0;
  for (int i = 0; i < static_cast<int>(s.triangles().size()); ++i) {
    const Corners t = cornersOf(s, i);
    const Vec3 a = t.a - p, b = t.b - p, c = t.c - p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    sum += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return std::abs(sum) > 2 * EIGEN_PI;
}

// Where the segment pq passes through a triangle, as the fraction from p.
std::optional<double> passage(const Vec3& p, const Vec3& q, const Corners& t) {
  const Vec3 n = (t.b - t.a).cross(t.c - t.a);
  const double hp = n.dot(p - t.a), hq = n.dot(q - t.a);
  if (!((hp < 0 && hq > 0) || (hp > 0 && hq < 0))) return std::nullopt;
  const Vec3 d = q - p, a = t.a - p, b = t.b - p, c = t.c - p;
  const double wa = d.dot(b.cross(c)), wb = d.dot(c.cross(a)), wc = d.dot(a.cross(b));
  const bool same = (wa >= 0 && wb >= 0 && wc >= 0) || (wa <= 0 && wb <= 0 && wc <= 0);
  if (!same) return std::nullopt;
  return hp / (hp - hq);
}

struct Passage {
  int edge;  // of the surface whose edges are examined
  double fraction;
  int face;  // of the other
};

void addPassages(const CollisionSurface& a, int ta, const CollisionSurface& b, int tb, std::vector<Passage>& out) {
  for (int i = 0; i < 3; ++i) {
    if (!a.ownsEdge(ta, i)) continue;
    const int edge = a.triangleEdges()[static_cast<size_t>(ta)][static_cast<size_t>(i)];
    const auto& e = a.edges()[static_cast<size_t>(edge)];
    const auto s = passage(at(a.start, e[0]), at(a.start, e[1]), cornersOf(b, tb));
    if (s) out.push_back({edge, *s, tb});
  }
}

void findPassages(const CollisionSurface& a, const CollisionSurface& b, std::vector<Passage>& a_through_b,
                  std::vector<Passage>& b_through_a) {
  std::vector<size_t> near_b;
  meetingClusters(a, b, [&](int ca, int cb) {
    const auto boxes_a = a.triangleBoxes(ca), boxes_b = b.triangleBoxes(cb);
    MovingBox around = boxes_a.front();
    for (const MovingBox& box : boxes_a) around.include(box);
    near_b.clear();
    for (size_t j = 0; j < boxes_b.size(); ++j)
      if (overlapAtStart(around, boxes_b[j])) near_b.push_back(j);
    for (size_t i = 0; i < boxes_a.size(); ++i)
      for (const size_t j : near_b) {
        if (!overlapAtStart(boxes_a[i], boxes_b[j])) continue;
        const int ta = a.trianglesOfCluster(ca)[i], tb = b.trianglesOfCluster(cb)[j];
        addPassages(a, ta, b, tb, a_through_b);
        addPassages(b, tb, a, ta, b_through_a);
      }
  });
  const auto order = [](const Passage& p, const Passage& q) {
    return p.edge != q.edge ? p.edge < q.edge : p.fraction != q.fraction ? p.fraction < q.fraction : p.face < q.face;
  };
  std::sort(a_through_b.begin(), a_through_b.end(), order);
  std::sort(b_through_a.begin(), b_through_a.end(), order);
}

// Vertices of a inside b. Regions of a that no face of b cuts are inside or outside as wholes.
std::vector<char> verticesInside(const CollisionSurface& a, const CollisionSurface& b,
                                 const std::vector<Passage>& passages) {
  std::vector<char> result(a.rest().size(), 0), seen(a.rest().size(), 0), cut(a.edges().size(), 0);
  if (!b.closed()) return result;
  for (const Passage& p : passages) cut[static_cast<size_t>(p.edge)] = 1;
  std::vector<int> region;
  for (size_t v = 0; v < seen.size(); ++v) {
    if (seen[v] != 0 || a.trianglesAtVertex(static_cast<int>(v)).empty()) continue;
    region.assign(1, static_cast<int>(v));
    seen[v] = 1;
    bool possible = true;
    for (size_t i = 0; i < region.size(); ++i) {
      const int w = region[i];
      possible = possible && contains(b.nodeBox(0), at(a.start, w));
      for (const int t : a.trianglesAtVertex(w))
        for (const int e : a.triangleEdges()[static_cast<size_t>(t)]) {
          const auto& ends = a.edges()[static_cast<size_t>(e)];
          if ((ends[0] != w && ends[1] != w) || cut[static_cast<size_t>(e)] != 0) continue;
          const int other = ends[0] == w ? ends[1] : ends[0];
          if (seen[static_cast<size_t>(other)] != 0) continue;
          seen[static_cast<size_t>(other)] = 1;
          region.push_back(other);
        }
    }
    if (!possible || !inside(b, at(a.start, static_cast<int>(v)))) continue;
    for (const int w : region) result[static_cast<size_t>(w)] = 1;
  }
  return result;
}

void setOther(OverlapPoint& o, const CollisionSurface& b, const SurfacePoint& p) {
  o.triangle = p.triangle;
  o.other_vertex = b.triangles()[static_cast<size_t>(p.triangle)];
  o.other_weight = p.weight;
  o.normal = p.normal;
  o.depth = p.distance;
}

// The pieces of one edge that lie inside; `first` to `last` are its passages, in order along it.
void addChords(const CollisionSurface& a, const CollisionSurface& b, const Passage* first, const Passage* last,
               OverlapPoint point, std::vector<OverlapPoint>& out) {
  const auto& e = a.edges()[static_cast<size_t>(first->edge)];
  const Vec3 &p = at(a.start, e[0]), &q = at(a.start, e[1]);
  point.vertex = {e[0], e[1], -1};
  bool any = false;
  for (const Passage* i = first; i + 1 < last; ++i) {
    const double middle = 0.5 * (i->fraction + (i + 1)->fraction);
    const Vec3 x = (1 - middle) * p + middle * q;
    if ((i + 1)->fraction - i->fraction < 1e-12 || !inside(b, x)) continue;
    point.weight = {1 - middle, middle, 0};
    setOther(point, b, closestPoint(b, x));
    out.push_back(point);
    any = true;
  }
  if (any) return;
  const Vec3 x = (1 - first->fraction) * p + first->fraction * q;
  const Corners t = cornersOf(b, first->face);
  const TrianglePoint on = closestOnTriangle(x, t.a, t.b, t.c);
  point.weight = {1 - first->fraction, first->fraction, 0};
  setOther(point, b, {first->face, on.weight, x, b.outwardNormal(first->face, on.weight, 0), 0});
  out.push_back(point);
}

void addPoints(const CollisionSurface& a, const CollisionSurface& b, const std::vector<Passage>& passages,
               bool of_first, std::vector<OverlapPoint>& out) {
  const std::vector<char> in = verticesInside(a, b, passages);
  OverlapPoint point;
  point.of_first = of_first;
  for (size_t v = 0; v < in.size(); ++v) {
    if (in[v] == 0) continue;
    point.vertex = {static_cast<int>(v), -1, -1};
    point.weight = {1, 0, 0};
    setOther(point, b, closestPoint(b, a.start[v]));
    out.push_back(point);
  }
  for (size_t i = 0, j = 0; i < passages.size(); i = j) {
    while (j < passages.size() && passages[j].edge == passages[i].edge) ++j;
    const auto& e = a.edges()[static_cast<size_t>(passages[i].edge)];
    if (in[static_cast<size_t>(e[0])] == 0 && in[static_cast<size_t>(e[1])] == 0)
      addChords(a, b, passages.data() + i, passages.data() + j, point, out);
  }
}

}  // namespace

bool inside(const CollisionSurface& surface, const Vec3& point) {
  if (!surface.closed() || !contains(surface.nodeBox(0), point)) return false;
  // no two of the components alike and none zero, so that grids and boxes are met at odd angles
  static const std::array<Vec3, 6> directions{Vec3(0.5773, 0.2113, 0.7887),   Vec3(-0.3217, 0.8519, 0.4129),
                                              Vec3(0.1371, -0.6917, 0.7091),  Vec3(-0.7431, -0.1973, -0.6394),
                                              Vec3(0.8819, -0.3533, -0.3121), Vec3(-0.4507, 0.5393, -0.7113)};
  for (const Vec3& direction : directions)
    if (const auto answer = insideByRay(surface, point, direction.normalized())) return *answer;
  return insideByWinding(surface, point);
}

SurfacePoint closestPoint(const CollisionSurface& surface, const Vec3& point) {
  SurfacePoint best;
  best.distance = std::numeric_limits<double>::infinity();
  std::array<std::pair<double, int>, 64> stack;
  size_t size = 0;
  const auto push = [&](int node) { stack[size++] = {squaredDistance(surface.nodeBox(node), point), node}; };
  push(0);
  while (size > 0) {
    const auto [distance2, i] = stack[--size];
    if (distance2 > best.distance * best.distance) continue;
    const auto& node = surface.nodes()[static_cast<size_t>(i)];
    if (node.right >= 0) {
      push(node.right);
      push(i + 1);
      if (stack[size - 1].first > stack[size - 2].first) std::swap(stack[size - 1], stack[size - 2]);
      continue;
    }
    const auto boxes = surface.triangleBoxes(node.cluster);
    const auto triangles = surface.trianglesOfCluster(node.cluster);
    for (size_t k = 0; k < boxes.size(); ++k) {
      if (squaredDistance(boxes[k], point) > best.distance * best.distance) continue;
      const Corners t = cornersOf(surface, triangles[k]);
      const TrianglePoint q = closestOnTriangle(point, t.a, t.b, t.c);
      if (q.distance > best.distance || (q.distance == best.distance && triangles[k] > best.triangle)) continue;
      best.distance = q.distance;
      best.triangle = triangles[k];
      best.weight = q.weight;
    }
  }
  const Corners t = cornersOf(surface, best.triangle);
  best.position = best.weight[0] * t.a + best.weight[1] * t.b + best.weight[2] * t.c;
  best.normal = surface.outwardNormal(best.triangle, best.weight, 0);
  return best;
}

void findOverlaps(const CollisionSurface& a, const CollisionSurface& b, std::vector<OverlapPoint>& out) {
  if (a.nodes().empty() || b.nodes().empty() || !overlapAtStart(a.nodeBox(0), b.nodeBox(0))) return;
  std::vector<Passage> a_through_b, b_through_a;
  findPassages(a, b, a_through_b, b_through_a);
  addPoints(a, b, a_through_b, true, out);
  addPoints(b, a, b_through_a, false, out);
}

}  // namespace palpate
