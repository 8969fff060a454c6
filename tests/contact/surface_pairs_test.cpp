#include "palpate/contact/surface_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "palpate/common/error.h"
#include "palpate/contact/overlap.h"
#include "shared/surface_motions.h"

namespace palpate {
namespace {

using namespace test;

using Kind = FeaturePair::Kind;
const double kPi = 3.14159265358979323846;
const Eigen::Affine3d kHere = Eigen::Affine3d::Identity();

Eigen::Affine3d shifted(const Vec3& d) { return affine(Mat3::Identity(), d); }

Vec3 weighted(const std::array<int, 3>& v, const std::array<double, 3>& w, const CollisionSurface& s, double t) {
  Vec3 p = Vec3::Zero();
  for (size_t i = 0; i < 3; ++i)
    if (v[i] >= 0) p += w[i] * ((1 - t) * pointOf(s.start, v[i]) + t * pointOf(s.end, v[i]));
  return p;
}

void expectSound(const FeaturePair& p, const CollisionSurface& a, const CollisionSurface& b, double reach) {
  const Vec3 first = weighted(p.first_vertex, p.first_weight, a, p.reference_time);
  const Vec3 second = weighted(p.second_vertex, p.second_weight, b, p.reference_time);
  EXPECT_NEAR(p.normal.norm(), 1, 1e-9);
  EXPECT_NEAR(p.normal.dot(first - second), (first - second).norm(), 1e-9);
  EXPECT_TRUE(p.hit || p.start_distance < reach || p.end_distance < reach);
  EXPECT_TRUE(std::isfinite(p.start_distance) && std::isfinite(p.end_distance));
  EXPECT_EQ(p.hit ? p.toi : p.reference_time, p.reference_time);
  const auto owns = [](const CollisionSurface& s, int triangle, const std::array<int, 3>& v) {
    const auto& t = s.triangles()[static_cast<size_t>(triangle)];
    return std::all_of(v.begin(), v.end(), [&](int i) { return i < 0 || std::count(t.begin(), t.end(), i) == 1; });
  };
  EXPECT_TRUE(owns(a, p.first_triangle, p.first_vertex));
  EXPECT_TRUE(owns(b, p.second_triangle, p.second_vertex));
}

void expectUnique(const std::vector<FeaturePair>& pairs) {
  std::set<std::tuple<int, int, int>> seen;
  for (const auto& p : pairs)
    EXPECT_TRUE(seen.emplace(static_cast<int>(p.kind), p.first_feature, p.second_feature).second);
}

// The vertex itself, or, where two vertices are nearest to each other, that pair the other way round.
bool represents(const FeaturePair& p, Kind kind, int vertex) {
  const auto& mine = kind == Kind::vertex_face ? p.first_vertex : p.second_vertex;
  const auto& weight = kind == Kind::vertex_face ? p.first_weight : p.second_weight;
  if (p.kind == Kind::edge_edge) return false;
  for (size_t i = 0; i < 3; ++i)
    if (mine[i] == vertex && weight[i] > 1 - 1e-6) return true;
  return false;
}

// The vertex's nearest point is on an edge or a corner, and the vertex's own surface comes nearer to it elsewhere.
bool besideEdge(int v, const CollisionSurface& mine, const CollisionSurface& other, bool at_end) {
  const double t = at_end ? 1 : 0;
  const Vec3 x = mine.position(v, t);
  TrianglePoint best;
  best.distance = 1e300;
  Vec3 nearest;
  for (const auto& f : other.triangles()) {
    const Vec3 a = other.position(f[0], t), b = other.position(f[1], t), c = other.position(f[2], t);
    const TrianglePoint q = closestOnTriangle(x, a, b, c);
    if (q.distance >= best.distance) continue;
    best = q;
    nearest = q.weight[0] * a + q.weight[1] * b + q.weight[2] * c;
  }
  return std::min({best.weight[0], best.weight[1], best.weight[2]}) < 1e-6 &&
         vertexDistance(nearest, mine, at_end ? mine.end : mine.start) < best.distance * (1 - 1e-12);
}

// A vertex's distance at one end of the path is that of a pair, unless it is only beside an edge.
void expectVerticesRepresented(const CollisionSurface& mine, const CollisionSurface& other, Kind kind, bool at_end,
                               double reach, const std::vector<FeaturePair>& pairs) {
  const auto& x = at_end ? mine.end : mine.start;
  for (int v = 0; v < static_cast<int>(x.size()); ++v) {
    const double d = vertexDistance(pointOf(x, v), other, at_end ? other.end : other.start);
    if (d >= reach * (1 - 1e-9) || besideEdge(v, mine, other, at_end)) continue;
    double best = 1e300;
    for (const auto& p : pairs)
      if (represents(p, kind, v)) best = std::min(best, at_end ? p.end_distance : p.start_distance);
    EXPECT_NEAR(best, d, 1e-12) << "vertex " << v << (at_end ? " at the end" : " at the start");
  }
}

// Puts b at about `gap` from a, along a random direction.
Eigen::Affine3d nextTo(CollisionSurface& a, CollisionSurface& b, double gap, Chance& chance) {
  const Vec3 d = chance.direction();
  Eigen::Affine3d t = affine(chance.rotation(), 0.2 * d);
  place(a, kHere, kHere);
  for (int i = 0; i < 30; ++i) {
    place(b, t, t);
    const double distance = bruteDistance(a, a.start, b, b.start);
    if (distance < 1.5 * gap) break;
    t.translation() -= (distance - gap) * d;
  }
  return t;
}

TEST(CollisionSurface, KnowsClosedFromOpen) {
  const Surface box = boxSurface(Vec3(1, 1, 1));
  EXPECT_TRUE(CollisionSurface(box).closed());
  EXPECT_TRUE(CollisionSurface(sphereSurface(1, 2)).closed());
  Surface open = box;
  open.triangles.pop_back();
  EXPECT_FALSE(CollisionSurface(open).closed());
  Surface turned = box;
  std::swap(turned.triangles[3][0], turned.triangles[3][1]);
  EXPECT_FALSE(CollisionSurface(turned).closed());
  EXPECT_FALSE(CollisionSurface(Surface{}).closed());
}

TEST(CollisionSurface, EveryFeatureIsOwnedOnce) {
  const Surface surface = capsuleSurface(0.01, 0.02, 16);
  const CollisionSurface s(surface);
  std::vector<int> vertices(surface.vertices.size(), 0), edges(s.edges().size(), 0);
  for (int t = 0; t < static_cast<int>(s.triangles().size()); ++t)
    for (int i = 0; i < 3; ++i) {
      const auto f = static_cast<size_t>(t), k = static_cast<size_t>(i);
      if (s.ownsCorner(t, i)) ++vertices[static_cast<size_t>(s.triangles()[f][k])];
      if (s.ownsEdge(t, i)) ++edges[static_cast<size_t>(s.triangleEdges()[f][k])];
      const auto& e = s.edges()[static_cast<size_t>(s.triangleEdges()[f][k])];
      EXPECT_EQ(e[0] + e[1], s.triangles()[f][k] + s.triangles()[f][(k + 1) % 3]);
    }
  EXPECT_TRUE(std::all_of(vertices.begin(), vertices.end(), [](int n) { return n == 1; }));
  EXPECT_TRUE(std::all_of(edges.begin(), edges.end(), [](int n) { return n == 1; }));
  EXPECT_EQ(2 * s.edges().size(), 3 * s.triangles().size());
}

TEST(CollisionSurface, TellsEdgesThatStayHollow) {
  const auto hollow = [](const Surface& surface, const std::vector<int>& carrier = {}) {
    CollisionSurface s(surface);
    EXPECT_FALSE(s.hollow(0));
    s.findHollow(carrier);
    int count = 0;
    for (int e = 0; e < static_cast<int>(s.edges().size()); ++e) count += s.hollow(e) ? 1 : 0;
    return count;
  };
  const Surface box = boxSurface(Vec3(1, 1, 1));
  EXPECT_EQ(hollow(box), 6);  // the faces' diagonals
  Surface room = box;
  for (auto& t : room.triangles) std::swap(t[0], t[1]);
  EXPECT_EQ(hollow(room), 18);
  const Surface ball = sphereSurface(1, 2);
  EXPECT_EQ(hollow(ball), 0);
  Surface open = room;
  open.triangles.pop_back();
  EXPECT_EQ(hollow(open), 0);

  // one corner moves by itself: the three faces there may bend, each with its diagonal
  std::vector<int> carrier(box.vertices.size(), 4);
  carrier.front() = 7;
  EXPECT_EQ(hollow(box, carrier), 3);
}

TEST(CollisionSurface, ClustersKeepGivenGroupsAndSize) {
  const Surface surface = sphereSurface(1, 4);
  std::vector<int> group;
  for (const auto& t : surface.triangles) group.push_back(pointOf(surface.vertices, t[0]).x() > 0 ? 5 : 2);
  const CollisionSurface grouped(surface, group), plain(surface);
  size_t seen = 0;
  for (int c = 0; c < grouped.clusters(); ++c) {
    const auto triangles = grouped.trianglesOfCluster(c);
    EXPECT_LE(triangles.size(), 64u);
    seen += triangles.size();
    for (const int t : triangles) EXPECT_EQ(group[static_cast<size_t>(t)], group[static_cast<size_t>(triangles[0])]);
  }
  EXPECT_EQ(seen, surface.triangles.size());
  for (int c = 0; c < plain.clusters(); ++c) EXPECT_LE(plain.trianglesOfCluster(c).size(), 32u);
}

TEST(CollisionSurface, RejectsBadInput) {
  Surface s = boxSurface(Vec3(1, 1, 1));
  s.triangles[2][1] = 99;
  EXPECT_THROW(CollisionSurface{s}, InputError);
  s = boxSurface(Vec3(1, 1, 1));
  s.triangles[2][1] = s.triangles[2][0];
  EXPECT_THROW(CollisionSurface{s}, InputError);
  s = boxSurface(Vec3(1, 1, 1));
  EXPECT_THROW(CollisionSurface(s, std::vector<int>{1, 2}), InputError);
  s.vertices[0].x() = std::nan("");
  EXPECT_THROW(CollisionSurface{s}, InputError);
  const CollisionSurface good(boxSurface(Vec3(1, 1, 1)));
  EXPECT_THROW(SelfExclusion(good, {0}, {0, 0}, {}), InputError);
  EXPECT_THROW(SelfExclusion(good, std::vector<int>(8, 3), {0, 0}, {}), InputError);
}

TEST(CollisionSurface, BoxesHoldTheirTrianglesAtAllTimes) {
  Chance chance(11);
  CollisionSurface s(sphereSurface(0.03, 3));
  place(s, affine(chance.rotation(), chance.vector()), affine(chance.rotation(), chance.vector()));
  const auto expectIn = [](const MovingBox& box, const Vec3& p0, const Vec3& p1) {
    for (double t = 0; t <= 1; t += 0.125)
      for (int i = 0; i < 3; ++i) {
        const double x = (1 - t) * p0[i] + t * p1[i];
        EXPECT_LE((1 - t) * double{box.start_low[i]} + t * double{box.end_low[i]}, x);
        EXPECT_GE(-(1 - t) * double{box.start_negative_high[i]} - t * double{box.end_negative_high[i]}, x);
      }
  };
  for (int c = 0; c < s.clusters(); ++c)
    for (size_t k = 0; k < s.trianglesOfCluster(c).size(); ++k)
      for (const int v : s.triangles()[static_cast<size_t>(s.trianglesOfCluster(c)[k])]) {
        expectIn(s.triangleBoxes(c)[k], pointOf(s.start, v), pointOf(s.end, v));
        expectIn(s.nodeBox(0), pointOf(s.start, v), pointOf(s.end, v));
      }
}

TEST(SurfacePairs, NothingWithinReachIsLost) {
  SurfacePairFinder finder;
  size_t total = 0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    Chance chance(seed);
    CollisionSurface a(chance.surface()), b(chance.surface());
    const double gap = chance.in(2e-4, 2e-3), reach = chance.in(1.5, 4) * gap;
    const Eigen::Affine3d t = nextTo(a, b, gap, chance);
    // no vertex moves by more than a third of the gap, so nothing hits
    const Mat3 stretch = Mat3::Identity() + gap * Mat3::Random();
    place(b, t, affine(t.linear() * stretch, t.translation() + 0.1 * gap * chance.direction()));
    std::vector<FeaturePair> pairs;
    finder.find(a, b, reach, pairs);
    expectUnique(pairs);
    double least_start = 1e300, least_end = 1e300;
    for (const auto& p : pairs) {
      EXPECT_FALSE(p.hit);
      expectSound(p, a, b, reach);
      least_start = std::min(least_start, p.start_distance);
      least_end = std::min(least_end, p.end_distance);
    }
    total += pairs.size();
    EXPECT_NEAR(least_start, bruteDistance(a, a.start, b, b.start), 1e-12);
    EXPECT_NEAR(least_end, bruteDistance(a, a.end, b, b.end), 1e-12);
    for (const bool at_end : {false, true}) {
      expectVerticesRepresented(a, b, Kind::vertex_face, at_end, reach, pairs);
      expectVerticesRepresented(b, a, Kind::face_vertex, at_end, reach, pairs);
    }
  }
  EXPECT_GT(total, 150u);
}

TEST(SurfacePairs, NearOnlyAtTheEnd) {
  // a slow approach, and one long enough to be taken in pieces
  CollisionSurface plate(boxSurface(Vec3(0.1, 0.1, 0.02), {9, 9, 2})), ball(sphereSurface(0.01, 2));
  for (const double way : {0.003, 0.2}) {
    const Vec3 end(0.0031, 0.0023, 0.0203);
    place(ball, shifted(end + Vec3(0, 0, way)), shifted(end));
    std::vector<FeaturePair> pairs;
    SurfacePairFinder().find(ball, plate, 1e-3, pairs);
    ASSERT_FALSE(pairs.empty());
    for (const auto& p : pairs) {
      EXPECT_FALSE(p.hit);
      EXPECT_EQ(p.reference_time, 1);
      expectSound(p, ball, plate, 1e-3);
    }
    expectVerticesRepresented(ball, plate, Kind::vertex_face, true, 1e-3, pairs);
    expectVerticesRepresented(plate, ball, Kind::face_vertex, true, 1e-3, pairs);
  }
}

// Earliest hit of any vertex-face or edge-edge pair.
double bruteHit(const CollisionSurface& a, const CollisionSurface& b, double reach, Kind kind) {
  double first = 2;
  const auto consider = [&](FeatureKind k, double start, const std::array<Vec3, 4>& x0, const std::array<Vec3, 4>& x1) {
    const Approach r = timeOfApproach(k, x0, x1, 0.1 * std::min(start, reach));
    if (r.reached) first = std::min(first, r.time);
  };
  const auto vertexFace = [&](const CollisionSurface& s, int v, const CollisionSurface& o) {
    for (const auto& f : o.triangles()) {
      const std::array<Vec3, 4> x0{pointOf(s.start, v), pointOf(o.start, f[0]), pointOf(o.start, f[1]),
                                   pointOf(o.start, f[2])};
      consider(FeatureKind::vertex_face, closestOnTriangle(x0[0], x0[1], x0[2], x0[3]).distance, x0,
               {pointOf(s.end, v), pointOf(o.end, f[0]), pointOf(o.end, f[1]), pointOf(o.end, f[2])});
    }
  };
  if (kind == Kind::vertex_face)
    for (int v = 0; v < static_cast<int>(a.start.size()); ++v) vertexFace(a, v, b);
  if (kind == Kind::face_vertex)
    for (int v = 0; v < static_cast<int>(b.start.size()); ++v) vertexFace(b, v, a);
  if (kind == Kind::edge_edge)
    for (const auto& e : a.edges())
      for (const auto& f : b.edges()) {
        const std::array<Vec3, 4> x0{pointOf(a.start, e[0]), pointOf(a.start, e[1]), pointOf(b.start, f[0]),
                                     pointOf(b.start, f[1])};
        consider(FeatureKind::edge_edge, closestOnSegments(x0[0], x0[1], x0[2], x0[3]).distance, x0,
                 {pointOf(a.end, e[0]), pointOf(a.end, e[1]), pointOf(b.end, f[0]), pointOf(b.end, f[1])});
      }
  return first;
}

TEST(SurfacePairs, TheFirstHitIsFound) {
  SurfacePairFinder finder;
  int with_hit = 0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    Chance chance(1000 + seed);
    CollisionSurface a(chance.surface()), b(chance.surface());
    const double reach = 1e-3;
    const Eigen::Affine3d t = nextTo(a, b, chance.in(1e-3, 2e-2), chance);
    place(b, t,
          affine(chance.rotation(0.6) * t.linear(),
                 t.translation() - chance.in(0.1, 3) * t.translation() + chance.vector(0.02)));
    std::vector<FeaturePair> pairs;
    finder.find(a, b, reach, pairs);
    expectUnique(pairs);
    double first = 2;
    for (const auto& p : pairs) {
      expectSound(p, a, b, reach);
      if (p.hit) first = std::min(first, p.toi);
    }
    const double vertex = std::min(bruteHit(a, b, reach, Kind::vertex_face), bruteHit(a, b, reach, Kind::face_vertex));
    const double any = std::min(vertex, bruteHit(a, b, reach, Kind::edge_edge));
    if (any > 1) {
      EXPECT_GT(first, 1) << seed;
      continue;
    }
    ++with_hit;
    EXPECT_GE(first, any - 1e-12) << seed;
    EXPECT_LE(first, vertex + 1e-12) << seed;
    EXPECT_LE(first, any + 0.02) << seed;  // an edge's hit may be left to a vertex that comes a little later
    // up to the first hit nothing intersects
    CollisionSurface c = a, d = b;
    for (size_t i = 0; i < c.start.size(); ++i) c.start[i] = (1 - first) * a.start[i] + first * a.end[i];
    for (size_t i = 0; i < d.start.size(); ++i) d.start[i] = (1 - first) * b.start[i] + first * b.end[i];
    c.refit();
    d.refit();
    std::vector<OverlapPoint> overlaps;
    findOverlaps(c, d, overlaps);
    EXPECT_TRUE(overlaps.empty()) << seed;
  }
  EXPECT_GT(with_hit, 20);
}

TEST(SurfacePairs, AFastSphereDoesNotPassAThinPlate) {
  SurfacePairFinder finder;
  CollisionSurface plate(boxSurface(Vec3(0.1, 0.1, 0.001), {6, 6, 1})), sphere(sphereSurface(0.004, 2));
  for (unsigned seed = 0; seed < 200; ++seed) {
    Chance chance(seed);
    const Vec3 from(chance.in(-0.02, 0.02), chance.in(-0.02, 0.02), chance.in(0.01, 0.06));
    const Vec3 to(chance.in(-0.02, 0.02), chance.in(-0.02, 0.02), chance.in(-0.2, -0.02));
    const Mat3 turn = chance.rotation();
    place(sphere, affine(turn, from), affine(chance.rotation(0.6) * turn, to));
    std::vector<FeaturePair> pairs;
    finder.find(sphere, plate, 5e-4, pairs);
    double first = 2;
    for (const auto& p : pairs)
      if (p.hit) first = std::min(first, p.toi);
    for (const auto& p : pairs) {  // the first half millimeter: out of the side that the sphere comes from
      if (!p.hit || (p.toi - first) * (to - from).norm() > 5e-4) continue;
      EXPECT_GT(p.normal.z(), -0.1);
    }
    double low = 1e300;  // the vertices that far along are above the plate
    for (size_t i = 0; i < sphere.start.size(); ++i)
      low = std::min(low, (1 - first) * sphere.start[i].z() + first * sphere.end[i].z());
    EXPECT_LE(first, 1);
    EXPECT_GT(low, 0.0005);
    EXPECT_LT(low, 0.0005 + 5e-4);
  }
}

TEST(SurfacePairs, FlatOnFlatGivesOnePairAVertex) {
  CollisionSurface lower(boxSurface(Vec3(0.1, 0.1, 0.02), {10, 10, 2}));
  CollisionSurface upper(boxSurface(Vec3(0.04, 0.04, 0.02), {7, 7, 2}));
  SurfacePairFinder finder;
  for (const double drop : {0.0, 1e-4, 2e-3}) {  // rest, approach, impact
    place(lower, kHere, kHere);
    place(upper, shifted(Vec3(0.0011, 0.0007, 0.0202)), shifted(Vec3(0.0011, 0.0007, 0.0202 - drop)));
    std::vector<FeaturePair> pairs;
    finder.find(upper, lower, 1e-3, pairs);
    std::array<int, 3> count{};
    for (const auto& p : pairs) {
      if (drop > 1e-3 && p.toi > 0.1) continue;  // the flat sides meet at 0.09; what comes later is past that
      ++count[static_cast<size_t>(p.kind)];
      EXPECT_EQ(p.hit, drop > 1e-3);
      EXPECT_NEAR(p.normal.z(), 1, 1e-9);
      EXPECT_NEAR(p.start_distance, 2e-4, 1e-12);
    }
    EXPECT_EQ(count[0], 64);  // the upper box's vertices
    EXPECT_EQ(count[1], 16);  // the lower one's, below it
    // the outline of the upper box crosses edges of the lower one, inside its flat face: the vertices say it all
    EXPECT_EQ(count[2], 0);
  }
}

TEST(SurfacePairs, CrossedBarsTouchByTheirEdgesAlone) {
  CollisionSurface lower(boxSurface(Vec3(0.1, 0.02, 0.02))), upper(boxSurface(Vec3(0.02, 0.1, 0.02)));
  place(upper, shifted(Vec3(0, 0, 0.0203)), shifted(Vec3(0, 0, 0.0203)));
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs;
  finder.find(upper, lower, 1e-3, pairs);
  std::set<std::pair<int, int>> corners;
  for (const auto& p : pairs) {
    EXPECT_EQ(p.kind, Kind::edge_edge);
    EXPECT_NEAR(p.normal.z(), 1, 1e-9);
    const Vec3 x = weighted(p.first_vertex, p.first_weight, upper, 0);
    corners.emplace(std::lround(100 * x.x()), std::lround(100 * x.y()));
  }
  EXPECT_EQ(corners, (std::set<std::pair<int, int>>{{-1, -1}, {-1, 1}, {1, -1}, {1, 1}}));
  // falling onto each other they do so all the same
  place(upper, shifted(Vec3(0, 0, 0.0203)), shifted(Vec3(0, 0, 0.019)));
  pairs.clear();
  finder.find(upper, lower, 1e-3, pairs);
  EXPECT_GE(std::count_if(pairs.begin(), pairs.end(), [](const FeaturePair& p) { return p.hit; }), 4);
}

// A plate on a ridge, turned by half a milliradian, that drops onto it: its nearest place is at one rim, and the path
// hits both. Who asks what is near now gets both, as they are now.
TEST(SurfacePairs, AFaceOnARidgeHasBothItsEndsNow) {
  CollisionSurface ridge(Surface{{{-0.05, 0, 0}, {0.05, 0, 0}, {0, 0.02, -0.03}, {0, -0.02, -0.03}},
                                 {{0, 1, 2}, {1, 0, 3}, {0, 2, 3}, {1, 3, 2}}});
  CollisionSurface plate(boxSurface(Vec3(0.04, 0.03, 0.01)));
  const Mat3 turn = Eigen::AngleAxisd(5e-4, Vec3::UnitY()).toRotationMatrix();
  const double half = -0.5 * (plate.rest()[0].z() + plate.rest().back().z());  // to its middle
  place(plate, affine(turn, Vec3(0, 0, 0.0053 + half)), affine(turn, Vec3(0, 0, 0.0043 + half)));
  const auto rims = [&](bool as_now) {
    SurfacePairFinder finder;
    finder.setAsNow(as_now);
    std::vector<FeaturePair> pairs;
    finder.find(plate, ridge, 1e-3, pairs);
    std::set<long> out;
    for (const auto& p : pairs) {
      expectSound(p, plate, ridge, 1e-3);
      const Vec3 x = weighted(p.first_vertex, p.first_weight, plate, p.reference_time);
      if (as_now) {
        EXPECT_FALSE(p.hit);
        EXPECT_EQ(p.reference_time, 0);
        EXPECT_NEAR(p.start_distance, 3e-4, 2e-5);
      }
      out.insert(std::lround(100 * x.x()));
    }
    return out;
  };
  EXPECT_TRUE(rims(true).count(-2) == 1 && rims(true).count(2) == 1);
  EXPECT_FALSE(rims(false).empty());
}

TEST(SurfacePairs, SharpEdgesThatCross) {
  // two wedges, one turned upside down and across: their ridges cross at a distance of 0.2 mm
  const Surface wedge{{{-0.05, 0, 0}, {0.05, 0, 0}, {0, 0.02, -0.03}, {0, -0.02, -0.03}},
                      {{0, 1, 2}, {1, 0, 3}, {0, 2, 3}, {1, 3, 2}}};
  CollisionSurface lower(wedge), upper(wedge);
  const Mat3 turn =
      (Eigen::AngleAxisd(kPi / 2, Vec3::UnitZ()) * Eigen::AngleAxisd(kPi, Vec3::UnitX())).toRotationMatrix();
  place(upper, affine(turn, Vec3(0.003, 0.002, 2e-4)), affine(turn, Vec3(0.003, 0.002, 1e-4)));
  EXPECT_TRUE(lower.closed());
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs;
  finder.find(upper, lower, 1e-3, pairs);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_EQ(pairs[0].kind, Kind::edge_edge);
  EXPECT_NEAR(pairs[0].start_distance, 2e-4, 1e-12);
  EXPECT_NEAR(pairs[0].end_distance, 1e-4, 1e-12);
  EXPECT_NEAR(pairs[0].normal.z(), 1, 1e-9);
}

TEST(SurfacePairs, VertexOnVertexComesOnce) {
  const Surface octahedron = sphereSurface(0.01, 0);
  CollisionSurface lower(octahedron), upper(octahedron);
  for (const double drop : {0.0, 1e-3}) {
    place(upper, shifted(Vec3(0, 0, 0.0202)), shifted(Vec3(0, 0, 0.0202 - drop)));
    std::vector<FeaturePair> pairs;
    SurfacePairFinder().find(upper, lower, 1e-3, pairs);
    ASSERT_EQ(pairs.size(), 1u);
    EXPECT_NE(pairs[0].kind, Kind::edge_edge);
    EXPECT_EQ(pairs[0].hit, drop > 0);
    EXPECT_NEAR(pairs[0].normal.z(), 1, 1e-9);
  }
}

TEST(SurfacePairs, ExactTouchHasTheFacesNormal) {
  const Surface octahedron = sphereSurface(0.01, 0);
  CollisionSurface plate(boxSurface(Vec3(0.1, 0.1, 0.01), {3, 3, 1})), tip(octahedron);
  for (const double move : {0.0, -1e-3, 1e-3}) {
    place(tip, shifted(Vec3(0.003, 0.005, 0.015)), shifted(Vec3(0.003, 0.005, 0.015 + move)));
    std::vector<FeaturePair> pairs;
    SurfacePairFinder().find(tip, plate, 5e-4, pairs);
    ASSERT_FALSE(pairs.empty());
    int touching = 0;
    for (const auto& p : pairs) {
      EXPECT_TRUE(p.normal.allFinite());
      if (p.start_distance > 1e-12) continue;
      ++touching;
      EXPECT_NEAR(p.normal.z(), 1, 1e-9);
      EXPECT_EQ(p.hit, move <= 0);
      EXPECT_EQ(p.toi, move <= 0 ? 0 : 1);
      EXPECT_NEAR(p.end_distance, move, 1e-12);
    }
    EXPECT_EQ(touching, 1);
  }
  // ridge on ridge
  CollisionSurface lower(octahedron), upper(octahedron);
  const Mat3 up = Quat::FromTwoVectors(Vec3(1, 0, 1), Vec3::UnitZ()).toRotationMatrix();
  const Mat3 cross = Eigen::AngleAxisd(kPi / 2, Vec3::UnitZ()) * up;
  const double height = 2 * 0.01 * std::sqrt(0.5);
  place(lower, affine(up, Vec3::Zero()), affine(up, Vec3::Zero()));
  place(upper, affine(cross, Vec3(0, 0, height)), affine(cross, Vec3(0, 0, height - 1e-3)));
  std::vector<FeaturePair> pairs;
  SurfacePairFinder().find(upper, lower, 5e-4, pairs);
  ASSERT_FALSE(pairs.empty());
  EXPECT_TRUE(std::any_of(pairs.begin(), pairs.end(), [](const FeaturePair& p) {
    return p.kind == Kind::edge_edge && p.start_distance < 1e-12 && p.hit && p.normal.z() > 1 - 1e-6;
  }));
}

TEST(SurfacePairs, DegenerateTrianglesDoNoHarm) {
  Surface flat = boxSurface(Vec3(0.02, 0.02, 0.02), {2, 2, 2});
  for (Vec3& p : flat.vertices)
    if (p.x() > 0.005) p = Vec3(0.01, 0, 0.01);  // a whole side in one point
  CollisionSurface a(flat), b(flat);
  for (const double move : {0.0, -2e-3, -0.05}) {
    place(b, shifted(Vec3(0, 0, 0.0201)), shifted(Vec3(0, 0, 0.0201 + move)));
    std::vector<FeaturePair> pairs;
    SurfacePairFinder().find(b, a, 1e-3, pairs);
    EXPECT_FALSE(pairs.empty());
    for (const auto& p : pairs) expectSound(p, b, a, 1e-3);
    std::vector<OverlapPoint> overlaps;
    findOverlaps(a, b, overlaps);
    EXPECT_TRUE(overlaps.empty());
  }
}

TEST(SurfacePairs, EmptySurfacesHaveNoPairs) {
  CollisionSurface none(Surface{}), box(boxSurface(Vec3(1, 1, 1)));
  std::vector<FeaturePair> pairs;
  SurfacePairFinder finder;
  finder.find(none, box, 1, pairs);
  finder.find(box, none, 1, pairs);
  finder.find(CollisionSurface(), box, 1, pairs);
  finder.findSelf(none, SelfExclusion(), 1, pairs);
  EXPECT_TRUE(pairs.empty());
}

// A strip of length 0.1 bent into a C, whose ends face each other at the given gap.
TEST(SurfacePairs, SelfContactLeavesOutNeighborsAndFindsTheRest) {
  const int cells = 40;
  CollisionSurface s(strip(cells));
  bend(s, s.start, 6.2);
  bend(s, s.end, 6.2);
  s.refit();
  const double gap = (s.start[1] - s.start[static_cast<size_t>(3 * cells + 1)]).norm();
  EXPECT_LT(gap, 0.005);
  std::vector<int> group, offset{0}, neighbor;
  for (size_t i = 0; i < s.rest().size(); ++i) group.push_back(static_cast<int>(i) / 3);
  for (int g = 0; g <= cells; ++g) {
    for (int h = std::max(0, g - 4); h <= std::min(cells, g + 4); ++h)
      if (h != g) neighbor.push_back(h);
    offset.push_back(static_cast<int>(neighbor.size()));
  }
  const SelfExclusion exclusion(s, group, offset, neighbor);
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs, all;
  finder.findSelf(s, exclusion, 0.006, pairs);
  EXPECT_FALSE(pairs.empty());
  expectUnique(pairs);
  double least = 1e300;
  for (const auto& p : pairs) {
    expectSound(p, s, s, 0.006);
    EXPECT_FALSE(exclusion.excludes(p.first_vertex, p.second_vertex));
    EXPECT_GT(p.rest_distance, 0.006);
    least = std::min(least, p.start_distance);
  }
  // twin: every pair of features that is not excluded
  double brute = 1e300;
  for (int v = 0; v < static_cast<int>(s.start.size()); ++v)
    for (const auto& f : s.triangles())
      if (!exclusion.excludes({v, -1, -1}, f))
        brute = std::min(brute, closestOnTriangle(pointOf(s.start, v), pointOf(s.start, f[0]), pointOf(s.start, f[1]),
                                                  pointOf(s.start, f[2]))
                                    .distance);
  for (const auto& e : s.edges())
    for (const auto& f : s.edges())
      if (!exclusion.excludes({e[0], e[1], -1}, {f[0], f[1], -1}))
        brute = std::min(brute, closestOnSegments(pointOf(s.start, e[0]), pointOf(s.start, e[1]),
                                                  pointOf(s.start, f[0]), pointOf(s.start, f[1]))
                                    .distance);
  EXPECT_NEAR(least, brute, 1e-12);
  // neighbors along the surface are no contact even where nothing is excluded: each is nearer still beside the other
  finder.findSelf(s, SelfExclusion(), 0.006, all);
  EXPECT_EQ(all.size(), pairs.size());
  // ends that are near at rest say so
  CollisionSurface c(Surface{s.start, s.triangles()});
  all.clear();
  finder.findSelf(c, SelfExclusion(c, group, offset, neighbor), 0.006, all);
  EXPECT_EQ(all.size(), pairs.size());
  for (const auto& p : all) EXPECT_NEAR(p.rest_distance, p.start_distance, 1e-15);
}

TEST(SurfacePairs, SelfHitWhileFolding) {
  const int cells = 40;
  CollisionSurface s(strip(cells));
  bend(s, s.start, 5.5);
  bend(s, s.end, 7.5);
  s.refit();
  std::vector<int> group, offset{0}, neighbor;
  for (size_t i = 0; i < s.rest().size(); ++i) group.push_back(static_cast<int>(i) / 3);
  for (int g = 0; g <= cells; ++g) {
    for (int h = std::max(0, g - 4); h <= std::min(cells, g + 4); ++h) neighbor.push_back(h);
    offset.push_back(static_cast<int>(neighbor.size()));
  }
  std::vector<FeaturePair> pairs;
  SurfacePairFinder().findSelf(s, SelfExclusion(s, group, offset, neighbor), 1e-3, pairs);
  EXPECT_TRUE(std::any_of(pairs.begin(), pairs.end(), [](const FeaturePair& p) { return p.hit; }));
}

using Key = std::tuple<int, int, int, double, double>;
Key keyOf(const FeaturePair& x) {
  return {static_cast<int>(x.kind), x.first_feature, x.second_feature, x.toi, x.end_distance};
}

TEST(SurfacePairs, HollowEdgesAreMissedFromInsideAlone) {
  SurfacePairFinder finder;
  size_t hits = 0, edges = 0, hollow = 0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    Chance chance(seed);
    Surface dented = sphereSurface(0.02, 3);
    for (Vec3& v : dented.vertices) v *= chance.in(0.9, 1.1);
    const bool room = seed % 2 == 1;
    if (room) {
      for (auto& t : dented.triangles) std::swap(t[0], t[1]);
    }
    CollisionSurface a(dented), fixed(dented), b(sphereSurface(0.012, 3));
    fixed.findHollow();
    for (int e = 0; e < static_cast<int>(fixed.edges().size()); ++e) hollow += fixed.hollow(e) ? 1 : 0;
    const Vec3 from = (room ? 0.006 : 0.033) * chance.direction();
    const Eigen::Affine3d begin = affine(chance.rotation(), from);
    place(b, begin, affine(chance.rotation(0.1) * begin.linear(), from + chance.in(0, 0.004) * chance.direction()));
    std::vector<FeaturePair> all, found;
    finder.find(a, b, 1e-3, all);
    finder.find(fixed, b, 1e-3, found);
    std::set<Key> expected, other;
    for (const FeaturePair& p : all) {
      if (p.hit || !p.from_inside) expected.insert(keyOf(p));
      hits += p.hit ? 1 : 0;
      edges += p.kind == Kind::edge_edge ? 1 : 0;
    }
    for (const FeaturePair& p : found) {
      if (p.hit || !p.from_inside) other.insert(keyOf(p));
    }
    EXPECT_EQ(expected, other) << seed;
    EXPECT_LE(found.size(), all.size());
  }
  EXPECT_GT(hits, 100u);
  EXPECT_GT(edges, 100u);
  EXPECT_GT(hollow, 1000u);
}

// Whether the pair's line enters one of the surfaces beside the feature that it leaves: the other point is then nearer
// to a triangle there, by this share of the line's length.
bool entersBeside(const CollisionSurface& a, const CollisionSurface& b, const FeaturePair& p, double share) {
  const double t = p.reference_time;
  const Vec3 on_a = weighted(p.first_vertex, p.first_weight, a, t),
             on_b = weighted(p.second_vertex, p.second_weight, b, t);
  const auto nearer = [&](const CollisionSurface& s, const std::array<int, 3>& vertex, const std::array<double, 3>& w,
                          const Vec3& x) {
    return std::any_of(s.triangles().begin(), s.triangles().end(), [&](const auto& f) {
      for (size_t i = 0; i < 3; ++i)
        if (w[i] > 1e-6 && std::count(f.begin(), f.end(), vertex[i]) == 0) return false;
      const TrianglePoint q = closestOnTriangle(x, s.position(f[0], t), s.position(f[1], t), s.position(f[2], t));
      return q.distance < share * (on_a - on_b).norm();
    });
  };
  return nearer(a, p.first_vertex, p.first_weight, on_b) || nearer(b, p.second_vertex, p.second_weight, on_a);
}

// Who looks ahead misses hits of hollow edges and such as enter a face beside them, and never the first one.
TEST(SurfacePairs, LookingAheadMissesNoFirstHit) {
  SurfacePairFinder finder, ahead;
  ahead.setAhead(true);
  size_t hollow = 0, beside = 0, outlines = 0, seen = 0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    Chance chance(seed);
    Surface dented = sphereSurface(0.02, 3);
    for (Vec3& v : dented.vertices) v *= chance.in(0.9, 1.1);
    CollisionSurface a(dented), b(sphereSurface(0.012, 3));
    a.findHollow();
    b.findHollow();
    const Vec3 from = 0.036 * chance.direction();
    const Eigen::Affine3d begin = affine(chance.rotation(), from);
    place(b, begin, affine(chance.rotation(0.1) * begin.linear(), from - 0.2 * from + 0.003 * chance.direction()));
    std::vector<FeaturePair> all, found;
    finder.find(a, b, 1e-3, all);
    ahead.find(a, b, 1e-3, found);
    std::set<Key> keys;
    double first = 1, first_ahead = 1;
    for (const FeaturePair& p : found) {
      keys.insert(keyOf(p));
      first_ahead = std::min(first_ahead, p.toi);
      const auto interior = [](const std::array<double, 3>& w) { return *std::min_element(w.begin(), w.end()) > 1e-7; };
      // a vertex that comes late to the middle of a face is told of, and its normal is the face's
      if (!p.hit || interior(p.first_weight) || interior(p.second_weight)) continue;
      EXPECT_FALSE(entersBeside(a, b, p, 0.9)) << seed;
      ++outlines;
    }
    for (const FeaturePair& p : all) {
      first = std::min(first, p.toi);
      if (keys.count(keyOf(p)) != 0) continue;
      EXPECT_TRUE(p.hit) << seed;
      if (p.kind == Kind::edge_edge && (a.hollow(p.first_feature) || b.hollow(p.second_feature))) {
        ++hollow;
      } else {
        EXPECT_TRUE(entersBeside(a, b, p, 0.96)) << seed;
        ++beside;
      }
    }
    EXPECT_EQ(first_ahead, first) << seed;
    seen += found.size();
  }
  EXPECT_GT(hollow, 50u);
  EXPECT_GT(beside, 500u);
  EXPECT_GT(outlines, 200u);
  EXPECT_GT(seen, 500u);
}

TEST(SurfacePairs, ResultsDoNotDependOnTheClusters) {
  Chance chance(5);
  const Surface sa = sphereSurface(0.02, 3), sb = sphereSurface(0.015, 3);
  std::vector<int> group;
  for (const auto& t : sa.triangles) group.push_back(t[0] % 50);
  CollisionSurface a(sa), grouped(sa, group), b(sb);
  place(b, shifted(Vec3(0, 0.001, 0.0353)), affine(chance.rotation(0.1), Vec3(0, 0, 0.0347)));
  std::vector<FeaturePair> p, q;
  SurfacePairFinder finder;
  finder.find(a, b, 1e-3, p);
  finder.find(grouped, b, 1e-3, q);
  std::set<Key> kp, kq;
  for (const auto& x : p) kp.insert(keyOf(x));
  for (const auto& x : q) kq.insert(keyOf(x));
  EXPECT_GT(p.size(), 5u);
  EXPECT_EQ(kp, kq);
}

}  // namespace
}  // namespace palpate
