#include "palpate/contact/overlap.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/mesh/winding_number.h"
#include "shared/surface_motions.h"

namespace palpate {
namespace {

using namespace test;

Eigen::Affine3d movedBy(const Vec3& d) { return affine(Mat3::Identity(), d); }

TEST(Inside, AgreesWithTheBoxItself) {
  const Vec3 half(0.02, 0.03, 0.05);
  const CollisionSurface box(boxSurface(2 * half, {4, 3, 5}));
  Chance chance(1);
  for (int i = 0; i < 3000; ++i) {
    const Vec3 p = chance.vector().cwiseProduct(1.4 * half);
    EXPECT_EQ(inside(box, p), (p.cwiseAbs().array() < half.array()).all()) << p.transpose();
  }
  // lattice points in line with vertices and edges
  for (int i = -5; i <= 5; ++i)
    for (int j = -5; j <= 5; ++j)
      for (int k = -5; k <= 5; ++k) {
        const Vec3 p = Vec3(i, j, k).cwiseProduct(half) / 4;
        const double margin = (p.cwiseAbs() - half).maxCoeff();
        if (std::abs(margin) < 1e-12) continue;
        EXPECT_EQ(inside(box, p), margin < 0) << p.transpose();
      }
}

TEST(Inside, RaysThroughEdgesAndCornersAreTakenAgain) {
  // points placed so that rays of many directions, among them those in use, run exactly into vertices and edges
  const CollisionSurface box(boxSurface(Vec3(2, 2, 2), {2, 2, 2}));
  for (const Vec3& d : {Vec3(0.5773, 0.2113, 0.7887), Vec3(-0.3217, 0.8519, 0.4129), Vec3(1, 1, 1), Vec3(1, 0, 0)})
    for (const Vec3& target : box.rest())
      for (const double back : {0.1, 0.7, 3.0}) {
        const Vec3 p = target - back * d.normalized();
        const double margin = p.cwiseAbs().maxCoeff() - 1;
        if (std::abs(margin) < 1e-12) continue;
        EXPECT_EQ(inside(box, p), margin < 0) << p.transpose();
      }
}

TEST(Inside, AgreesWithTheWindingNumber) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    Chance chance(seed);
    CollisionSurface s(chance.surface());
    place(s, affine(chance.rotation(), chance.vector(0.1)), movedBy(Vec3::Zero()));
    const WindingNumber twin(Surface{s.start, s.triangles()});
    Vec3 center = Vec3::Zero();
    for (const Vec3& p : s.start) center += p / static_cast<double>(s.start.size());
    int count = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec3 p = center + chance.vector(0.03);
      EXPECT_EQ(inside(s, p), twin.exactAt(p) > 0.5);
      count += inside(s, p) ? 1 : 0;
    }
    EXPECT_GT(count, 5);
  }
}

TEST(Inside, OfAnOpenSurfaceIsNothing) {
  Surface open = boxSurface(Vec3(1, 1, 1));
  open.triangles.pop_back();
  EXPECT_FALSE(inside(CollisionSurface(open), Vec3::Zero()));
  EXPECT_FALSE(inside(CollisionSurface(), Vec3::Zero()));
}

TEST(ClosestPoint, IsTheSpheres) {
  const double r = 0.03;
  const CollisionSurface sphere(sphereSurface(r, 4));
  Chance chance(2);
  for (int i = 0; i < 500; ++i) {
    const Vec3 p = chance.in(0.2, 1.5) * r * chance.direction();
    const SurfacePoint q = closestPoint(sphere, p);
    EXPECT_NEAR(q.distance, vertexDistance(p, sphere, sphere.start), 1e-15);
    EXPECT_NEAR((q.position - p).norm(), q.distance, 1e-15);
    EXPECT_NEAR(q.normal.dot(p.normalized()), 1, 0.01);
  }
}

TEST(ClosestPoint, NormalsOfEdgesAndCornersLieBetween) {
  const CollisionSurface box(boxSurface(Vec3(2, 2, 2)));
  EXPECT_TRUE(closestPoint(box, Vec3(2, 2, 2)).normal.isApprox(Vec3(1, 1, 1).normalized(), 1e-12));
  EXPECT_TRUE(closestPoint(box, Vec3(2, 2, 0.3)).normal.isApprox(Vec3(1, 1, 0).normalized(), 1e-12));
  EXPECT_TRUE(closestPoint(box, Vec3(2, 0.1, 0.3)).normal.isApprox(Vec3(1, 0, 0), 1e-12));
}

TEST(Overlaps, SpheresInEachOther) {
  CollisionSurface a(sphereSurface(0.02, 3)), b(sphereSurface(0.03, 3));
  for (const double distance : {0.055, 0.049, 0.045, 0.02, 0.005}) {
    place(b, movedBy(Vec3(0, 0, distance)), movedBy(Vec3::Zero()));
    std::vector<OverlapPoint> points;
    findOverlaps(a, b, points);
    EXPECT_EQ(points.empty(), distance > 0.05);
    size_t vertices[2] = {0, 0};
    for (const auto& p : points) {
      const CollisionSurface &mine = p.of_first ? a : b, &other = p.of_first ? b : a;
      Vec3 x = Vec3::Zero(), y = Vec3::Zero();
      for (size_t i = 0; i < 3; ++i) {
        if (p.vertex[i] >= 0) x += p.weight[i] * pointOf(mine.start, p.vertex[i]);
        y += p.other_weight[i] * pointOf(other.start, p.other_vertex[i]);
      }
      if (p.vertex[1] < 0) ++vertices[p.of_first ? 0 : 1];
      EXPECT_NEAR((y - x).norm(), p.depth, 1e-12);
      EXPECT_NEAR(p.depth, vertexDistance(x, other, other.start), 1e-12);
      EXPECT_NEAR(p.normal.norm(), 1, 1e-12);
      if (p.depth < 1e-6) continue;
      EXPECT_NEAR(p.normal.dot((y - x).normalized()), 1, 0.05);
    }
    size_t expected[2] = {0, 0};
    for (const Vec3& x : a.start) expected[0] += WindingNumber({b.start, b.triangles()}).exactAt(x) > 0.5;
    for (const Vec3& x : b.start) expected[1] += WindingNumber({a.start, a.triangles()}).exactAt(x) > 0.5;
    EXPECT_EQ(vertices[0], expected[0]);
    EXPECT_EQ(vertices[1], expected[1]);
  }
}

TEST(Overlaps, ABarThroughAPlateIsSeenByItsEdges) {
  // no vertex of either is inside the other
  CollisionSurface bar(boxSurface(Vec3(0.01, 0.01, 0.1))), plate(boxSurface(Vec3(0.1, 0.1, 0.004)));
  place(bar, affine(Chance(3).rotation(0.3), Vec3(0.011, 0.007, 0.003)), movedBy(Vec3::Zero()));
  std::vector<OverlapPoint> points;
  findOverlaps(plate, bar, points);
  ASSERT_FALSE(points.empty());
  int of_bar = 0;
  for (const auto& p : points) {
    EXPECT_GE(p.vertex[1], 0);
    if (p.of_first) continue;
    ++of_bar;
    EXPECT_NEAR(std::abs(p.normal.z()), 1, 1e-9);
    EXPECT_NEAR(p.depth, 0.002, 1e-9);
  }
  EXPECT_GE(of_bar, 4);
}

TEST(Overlaps, OneInsideTheOtherWithoutAnyCrossing) {
  CollisionSurface small(sphereSurface(0.01, 2)), large(boxSurface(Vec3(0.1, 0.1, 0.1), {3, 3, 3}));
  std::vector<OverlapPoint> points;
  findOverlaps(large, small, points);
  EXPECT_EQ(points.size(), small.start.size());
  for (const auto& p : points) EXPECT_FALSE(p.of_first);
  // a hollow in the solid is outside: the inner wall faces inward
  Surface hollow = boxSurface(Vec3(0.1, 0.1, 0.1), {3, 3, 3});
  const Surface wall = boxSurface(Vec3(0.05, 0.05, 0.05));
  const int first = static_cast<int>(hollow.vertices.size());
  hollow.vertices.insert(hollow.vertices.end(), wall.vertices.begin(), wall.vertices.end());
  for (const auto& t : wall.triangles) hollow.triangles.push_back({t[0] + first, t[2] + first, t[1] + first});
  points.clear();
  findOverlaps(CollisionSurface(hollow), small, points);
  EXPECT_TRUE(points.empty());
}

TEST(Overlaps, OpenSheetThroughASolid) {
  CollisionSurface solid(sphereSurface(0.02, 3));
  CollisionSurface sheet(Surface{{{-1, -1, 0.003}, {1, -1, 0.003}, {0, 1, 0.003}}, {{0, 1, 2}}});
  std::vector<OverlapPoint> points;
  findOverlaps(solid, sheet, points);
  EXPECT_FALSE(points.empty());
  for (const auto& p : points) {
    EXPECT_TRUE(p.of_first);
    EXPECT_EQ(p.depth, 0);
    EXPECT_NEAR(std::abs(p.normal.z()), 1, 1e-12);
  }
}

}  // namespace
}  // namespace palpate
