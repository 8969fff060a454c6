// Surfaces whose vertices are placed only where something comes near: nothing is missed, and nothing is read that was
// not placed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>
#include <vector>

#include "palpate/contact/neighbor_exclusion.h"
#include "palpate/contact/self_intersections.h"
#include "palpate/contact/surface_pairs.h"
#include "palpate/mesh/embed_surface.h"
#include "shared/surface_motions.h"

namespace palpate {
namespace {

using namespace test;

// A ball of a few large tetrahedra under many small triangles, and its twin whose vertices are all placed.
struct Ball {
  const SimulationMesh& mesh;
  EmbeddingMap map;
  CollisionSurface sparse, placed;
  SelfExclusion exclusion;
  MotionBounds bounds;

  explicit Ball(int tetrahedra) : mesh(meshOf(tetrahedra)) {
    map = EmbeddingMap(mesh.mesh, mesh.embedding);
    std::vector<int> clusters, patches;
    for (const auto& t : mesh.surface.triangles) {
      clusters.push_back(mesh.embedding[static_cast<size_t>(t[0])].tetrahedron);
    }
    for (const EmbeddedPoint& p : mesh.embedding) patches.push_back(p.tetrahedron);
    placed = CollisionSurface(mesh.surface, clusters);
    sparse = CollisionSurface(mesh.surface, clusters);
    sparse.follow(map);
    exclusion = excludeNeighbors(placed, patches, mesh.mesh);
  }
  static const SimulationMesh& meshOf(int tetrahedra) {
    static std::map<int, SimulationMesh> known;
    const auto at = known.find(tetrahedra);
    if (at != known.end()) return at->second;
    EmbedOptions options;
    options.target_tetrahedra = tetrahedra;
    return known.emplace(tetrahedra, embedSurface(sphereSurface(0.03, 5), options)).first->second;
  }
  // At rest, strained and bent at random, turned and moved.
  VecX nodes(Chance& chance, const Vec3& center, double strain) const {
    const Mat3 turn = chance.rotation();
    const double wave = chance.in(50, 150), height = 0.01 * strain;
    VecX x(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
    for (size_t i = 0; i < mesh.mesh.nodes.size(); ++i) {
      Vec3 p = mesh.mesh.nodes[i];
      p.z() += height * std::sin(wave * p.x());
      p += chance.vector(0.002 * strain);
      x.segment<3>(static_cast<Eigen::Index>(3 * i)) = turn * p + center;
    }
    return x;
  }
  // Vertices that are read without being placed are not numbers.
  void move(const VecX& from, const VecX& to) {
    sparse.moveStart(from);
    sparse.moveEnd(to);
    const Vec3 unknown = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
    std::fill(sparse.start.begin(), sparse.start.end(), unknown);
    std::fill(sparse.end.begin(), sparse.end.end(), unknown);
    map.interpolate(from.data(), placed.start.data()->data());
    map.interpolate(to.data(), placed.end.data()->data());
    placed.refit();
    sparse.refit(placed.bounds());
  }
};

size_t placedVertices(const CollisionSurface& s) {
  return static_cast<size_t>(
      std::count_if(s.start.begin(), s.start.end(), [](const Vec3& p) { return p.allFinite(); }));
}

auto whatIsFound(const FeaturePair& p) {
  return std::tuple(p.kind, p.first_feature, p.second_feature, p.hit, p.toi, p.start_distance, p.end_distance,
                    p.from_inside, p.normal.x(), p.normal.y(), p.normal.z());
}

void expectSamePairs(const std::vector<FeaturePair>& p, const std::vector<FeaturePair>& q) {
  ASSERT_EQ(p.size(), q.size());
  for (size_t i = 0; i < p.size(); ++i) EXPECT_EQ(whatIsFound(p[i]), whatIsFound(q[i]));
}

bool within(const MovingBox& inner, const MovingBox& outer) {
  MovingBox both = outer;
  both.include(inner);
  return (both.start_low == outer.start_low).all() && (both.start_negative_high == outer.start_negative_high).all() &&
         (both.end_low == outer.end_low).all() && (both.end_negative_high == outer.end_negative_high).all();
}

TEST(FollowedSurface, BoxesOfNodesHoldAllVertices) {
  Chance chance(3);
  Ball ball(60);
  ASSERT_TRUE(ball.sparse.sparse());
  double outside = 0;  // weights beyond [0, 1] are there
  for (const double w : ball.map.weights()) outside = std::max({outside, -w, w - 1});
  EXPECT_GT(outside, 0.01);
  for (int pose = 0; pose < 20; ++pose) {
    const Vec3 far = chance.vector(pose % 2 == 0 ? 0.1 : 30.0);
    ball.move(ball.nodes(chance, far, 1.0), ball.nodes(chance, far + chance.vector(0.02), 3.0));
    const auto& nodes = ball.placed.nodes();
    for (int i = 0; i < static_cast<int>(nodes.size()); ++i) {
      const MovingBox &bound = ball.sparse.nodeBox(i), &tight = ball.placed.nodeBox(i);
      ASSERT_TRUE(within(tight, bound)) << "node " << i;
      if (nodes[static_cast<size_t>(i)].right < 0) ASSERT_TRUE(within(ball.sparse.leafBox(i), bound)) << "node " << i;
    }
  }
}

TEST(FollowedSurface, FindsWhatASurfaceDoesWhoseVerticesAreAllPlaced) {
  Chance chance(8);
  Ball a(60), b(90);
  ASSERT_TRUE(a.sparse.sparse() && b.sparse.sparse());
  SurfacePairFinder finder;
  PairFront unused;
  std::vector<FeaturePair> lazy, all;
  size_t found = 0, hits = 0, mixed = 0;
  constexpr double kReach = 1e-3;
  for (int pose = 0; pose < 24; ++pose) {
    const Vec3 side = chance.direction();
    // near, passing by and going through each other
    const double start = chance.in(0.058, 0.075), end = pose % 3 == 0 ? start : chance.in(0.02, 0.075);
    a.move(a.nodes(chance, Vec3::Zero(), 0.3), a.nodes(chance, Vec3::Zero(), 0.3));
    const VecX from = b.nodes(chance, start * side, 0.3);
    VecX to = from;
    for (Eigen::Index i = 0; i < to.size(); i += 3) to.segment<3>(i) += (end - start) * side + chance.vector(0.001);
    b.move(from, to);
    lazy.clear();
    all.clear();
    finder.find(a.placed, b.placed, kReach, all);
    finder.find(a.sparse, b.sparse, kReach, lazy);
    expectSamePairs(lazy, all);
    found += all.size();
    for (const FeaturePair& p : all) hits += p.hit ? 1 : 0;
    lazy.clear();
    finder.find(a.placed, b.sparse, kReach, lazy);  // one of each kind
    expectSamePairs(lazy, all);
    mixed += lazy.size();
  }
  EXPECT_GT(found, 500u);
  EXPECT_GT(hits, 100u);
  EXPECT_EQ(mixed, found);
}

TEST(FollowedSurface, FindsTheNearestPlaceByBruteForce) {
  Chance chance(12);
  Ball a(60), b(90);
  SurfacePairFinder finder;
  for (int pose = 0; pose < 2; ++pose) {
    const VecX xa = a.nodes(chance, Vec3::Zero(), 0.3);
    VecX xb = b.nodes(chance, Vec3(0, 0, 0.08), 0.3);
    b.move(xb, xb);
    a.move(xa, xa);
    // only vertices that face the other ball can be nearest to it
    const auto least = [&] {
      double distance = 1e300;
      for (const Vec3& p : a.placed.start)
        if (p.z() > 0.02) distance = std::min(distance, vertexDistance(p, b.placed, b.placed.start));
      return distance;
    };
    const double before = least();
    for (Eigen::Index i = 2; i < xb.size(); i += 3) xb[i] -= before - 2e-4;  // to within reach
    b.move(xb, xb);
    const double brute = least();
    std::vector<FeaturePair> pairs;
    finder.find(a.sparse, b.sparse, std::max(2 * brute, 1e-3), pairs);
    double nearest = 1e300;
    for (const FeaturePair& p : pairs) nearest = std::min(nearest, p.start_distance);
    EXPECT_LE(nearest, brute * (1 + 1e-9));
    EXPECT_GT(nearest, 0);
  }
}

TEST(FollowedSurface, PassesThroughItselfWhereTheOtherDoes) {
  Chance chance(15);
  Ball ball(60);
  const SelfExclusion* exclusion = &ball.exclusion;
  SurfacePairFinder finder;
  size_t crossings = 0, found = 0, crossed = 0;
  for (int pose = 0; pose < 20; ++pose) {
    const VecX from = ball.nodes(chance, Vec3::Zero(), pose % 2 == 0 ? 1.0 : 6.0);
    VecX to = from;
    for (Eigen::Index i = 0; i < to.size(); i += 3) to.segment<3>(i) += chance.vector(0.002);
    ball.move(from, to);
    for (const SelfExclusion* excluded : {static_cast<const SelfExclusion*>(nullptr), exclusion}) {
      std::vector<std::array<int, 2>> lazy, all;
      findSelfIntersections(ball.sparse, lazy, excluded);
      findSelfIntersections(ball.placed, all, excluded);
      std::sort(lazy.begin(), lazy.end());
      std::sort(all.begin(), all.end());
      EXPECT_EQ(lazy, all);
      crossings += all.size();
    }
    ball.move(from, to);
    std::vector<FeaturePair> lazy, all;
    PairFront front;
    finder.findSelf(ball.sparse, ball.exclusion, 1e-3, lazy, &front);
    finder.findSelf(ball.placed, ball.exclusion, 1e-3, all);
    expectSamePairs(lazy, all);
    found += all.size();
    // a search that knows what was apart misses nothing after a motion
    ball.move(to, to);
    std::vector<std::array<int, 2>> kept, fresh;
    double moved = 0;
    for (Eigen::Index i = 0; i < to.size(); ++i) moved = std::max(moved, std::abs(to[i] - from[i]));
    findSelfIntersections(ball.sparse, kept, exclusion, &front, 2 * std::sqrt(3.0) * 1.5 * moved);
    findSelfIntersections(ball.sparse, fresh, exclusion);
    std::sort(kept.begin(), kept.end());
    std::sort(fresh.begin(), fresh.end());
    EXPECT_EQ(kept, fresh);
    crossed += fresh.size();
  }
  EXPECT_GT(crossings, 100u);
  EXPECT_GT(crossed, 10u);
  EXPECT_GT(found, 100u);
}

TEST(FollowedSurface, PlacesOnlyWhatIsNear) {
  Chance chance(4);
  Ball a(60), b(60);
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs;
  const VecX xa = a.nodes(chance, Vec3::Zero(), 0.1);
  a.move(xa, xa);
  const VecX apart = b.nodes(chance, Vec3(0, 0, 0.2), 0.1), near = b.nodes(chance, Vec3(0, 0, 0.061), 0.1);
  b.move(apart, apart);
  finder.find(a.sparse, b.sparse, 1e-3, pairs);
  EXPECT_EQ(placedVertices(a.sparse) + placedVertices(b.sparse), 0u);
  b.move(near, near);
  finder.find(a.sparse, b.sparse, 1e-3, pairs);
  EXPECT_GT(placedVertices(a.sparse), 0u);
  EXPECT_LT(placedVertices(a.sparse), a.sparse.start.size() / 3);
  a.sparse.placeAll();
  EXPECT_EQ(placedVertices(a.sparse), a.sparse.start.size());
}

}  // namespace
}  // namespace palpate
