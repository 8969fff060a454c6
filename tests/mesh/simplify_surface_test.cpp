#include "palpate/mesh/simplify_surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "palpate/math/triangle.h"
#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/surface_repair.h"

namespace palpate {
namespace {

// Against all triangles.
double distanceTo(const Surface& s, const Vec3& x) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& t : s.triangles)
    nearest = std::min(nearest, closestOnTriangle(x, s.vertices[t[0]], s.vertices[t[1]], s.vertices[t[2]]).distance);
  return nearest;
}

Vec3 randomPoint(const Surface& s, std::mt19937& random) {
  std::uniform_real_distribution<double> share(0, 1);
  const auto& t = s.triangles[random() % s.triangles.size()];
  double a = share(random), b = share(random);
  if (a + b > 1) {
    a = 1 - a;
    b = 1 - b;
  }
  return (1 - a - b) * s.vertices[t[0]] + a * s.vertices[t[1]] + b * s.vertices[t[2]];
}

Surface joined(Surface a, const Surface& b, const Vec3& shift) {
  const int first = static_cast<int>(a.vertices.size());
  for (const Vec3& x : b.vertices) a.vertices.push_back(x + shift);
  for (const auto& t : b.triangles) a.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  return a;
}

int crossings(const Surface& s) {
  const auto corners = [&s](const std::array<int, 3>& t) {
    return TriangleCorners{s.vertices[t[0]], s.vertices[t[1]], s.vertices[t[2]]};
  };
  int count = 0;
  for (std::size_t i = 0; i < s.triangles.size(); ++i)
    for (std::size_t j = i + 1; j < s.triangles.size(); ++j) {
      const auto &t = s.triangles[i], &u = s.triangles[j];
      if (std::find_first_of(t.begin(), t.end(), u.begin(), u.end()) != t.end()) continue;
      count += trianglesCross(corners(t), corners(u));
    }
  return count;
}

TEST(SimplifySurface, StaysWithinTheToleranceClosedAndOnItsVertices) {
  std::mt19937 random(5);
  for (const double tolerance : {1e-5, 1e-4, 1e-3}) {
    for (const Surface& fine : {sphereSurface(0.05, 5), capsuleSurface(0.01, 0.1, 64)}) {
      const SimplifiedSurface out = simplifySurface(fine, tolerance);
      EXPECT_TRUE(inspectTopology(out.surface).closed());
      EXPECT_EQ(inspectTopology(out.surface).euler, 2);
      EXPECT_LE(out.deviation, tolerance);
      for (int i = 0; i < 30; ++i) {
        EXPECT_LE(distanceTo(out.surface, randomPoint(fine, random)), 1.2 * tolerance);
        EXPECT_LE(distanceTo(fine, randomPoint(out.surface, random)), 1.2 * tolerance);
      }
      for (std::size_t i = 0; i < out.surface.vertices.size(); i += 40)
        EXPECT_EQ(distanceTo(fine, out.surface.vertices[i]), 0);
      const SurfaceMeasures a = measureSurface(fine), b = measureSurface(out.surface);
      EXPECT_NEAR(a.volume, b.volume, tolerance * a.area);
      if (tolerance > 2e-4) EXPECT_LT(out.surface.triangles.size(), fine.triangles.size() / 4);
    }
  }
}

// The tolerance is a user's: all triangles would be near to each vertex.
TEST(SimplifySurface, HugeTolerancesAreBounded) {
  const Surface fine = sphereSurface(0.05, 5);
  for (const double tolerance : {0.05, 1.0, 1e30}) {
    const SimplifiedSurface out = simplifySurface(fine, tolerance);
    EXPECT_LE(out.deviation, 0.01 * 0.1 * std::sqrt(3.0));
    EXPECT_TRUE(inspectTopology(out.surface).closed());
    EXPECT_GT(out.surface.triangles.size(), 50u);
  }
}

TEST(SimplifySurface, FlatFacesNeedFewTriangles) {
  const Surface fine = boxSurface(Vec3(0.1, 0.05, 0.02), {20, 10, 4});
  const SimplifiedSurface out = simplifySurface(fine, 1e-5);
  EXPECT_LE(out.surface.triangles.size(), 30u);  // no needles
  EXPECT_NEAR(measureSurface(out.surface).volume, 1e-4, 1e-15);
}

TEST(SimplifySurface, LeavesAloneWhatItMust) {
  const Surface coarse = boxSurface(Vec3(0.1, 0.05, 0.02)), fine = sphereSurface(0.05, 5);
  const auto same = [](const Surface& a, const SimplifiedSurface& b) {
    return a.vertices == b.surface.vertices && a.triangles == b.surface.triangles && b.deviation == 0;
  };
  EXPECT_TRUE(same(coarse, simplifySurface(coarse, 1e-3)));
  EXPECT_TRUE(same(fine, simplifySurface(fine, 0)));
  EXPECT_TRUE(same(fine, simplifySurface(fine, -1)));
  EXPECT_TRUE(same(fine, simplifySurface(fine, std::nan(""))));
  EXPECT_TRUE(same(fine, simplifySurface(fine, 1e-9)));
  EXPECT_TRUE(same({}, simplifySurface({}, 1)));
  // as good far from the origin
  Surface far = fine;
  for (Vec3& x : far.vertices) x += Vec3(1e5, -1e5, 1e5);
  const std::size_t count = simplifySurface(fine, 5e-4).surface.triangles.size();
  EXPECT_LT(count, fine.triangles.size() / 4);
  EXPECT_LT(simplifySurface(far, 5e-4).surface.triangles.size(), count + count / 10);
}

TEST(SimplifySurface, KeepsHolesPartsAndWhatLiesCloseApart) {
  Surface holed = sphereSurface(0.05, 5);
  holed.triangles.erase(holed.triangles.begin() + 100, holed.triangles.begin() + 140);
  holed = repairSurface(holed).surface;
  const SurfaceTopology before = inspectTopology(holed), after = inspectTopology(simplifySurface(holed, 5e-4).surface);
  EXPECT_GT(before.holes, 0);
  EXPECT_LE(after.holes, before.holes);
  EXPECT_EQ(after.components, 1);
  // two shells that are nearer to each other than the tolerance
  const Surface shells = joined(sphereSurface(0.05, 3), sphereSurface(0.0493, 3), Vec3::Zero());
  ASSERT_EQ(crossings(shells), 0);
  for (const double tolerance : {2e-4, 5e-4, 1e-3}) {
    const SimplifiedSurface out = simplifySurface(shells, tolerance);
    EXPECT_EQ(crossings(out.surface), 0) << tolerance;
    EXPECT_EQ(inspectTopology(out.surface).components, 2);
  }
  // a body smaller than the tolerance does not vanish
  const Surface speck = joined(sphereSurface(0.05, 4), sphereSurface(1e-4, 2), Vec3(0.1, 0, 0));
  EXPECT_EQ(inspectTopology(simplifySurface(speck, 1e-3).surface).components, 2);
}

TEST(SimplifySurface, MeshAndMassAreThoseOfTheSurfaceGiven) {
  const Surface fine = sphereSurface(0.05, 5);
  EmbedOptions options;
  EmbedReport all, fewer;
  const SimulationMesh a = embedSurface(fine, options, &all);
  options.surface_tolerance.reset();
  const SimulationMesh b = embedSurface(fine, options, &fewer);
  EXPECT_LT(b.surface.triangles.size(), a.surface.triangles.size() / 3);
  EXPECT_EQ(fewer.given_triangles, static_cast<int>(fine.triangles.size()));
  EXPECT_GT(fewer.surface_deviation, 0);
  EXPECT_LE(fewer.surface_deviation, kSurfaceTolerance * fewer.cell_size);
  EXPECT_EQ(all.surface_deviation, 0);
  EXPECT_EQ(a.mesh.nodes, b.mesh.nodes);
  EXPECT_EQ(a.fill, b.fill);
  EXPECT_EQ(a.share, b.share);
  options.surface_tolerance = -1.0;
  EXPECT_ANY_THROW(embedSurface(fine, options));
}

}  // namespace
}  // namespace palpate
