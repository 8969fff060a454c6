// The triangles that stand for analytic solids.
#include "palpate/contact/obstacle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "palpate/math/rotation.h"
#include "palpate/mesh/surface_measures.h"
#include "shared/analytic_solids.h"

namespace palpate {
namespace {

struct Solid {
  Obstacle obstacle;
  double volume;
  double round;  // radius of what is not flat
};

std::vector<Solid> solids() {
  const BoxShape box{{Vec3(0.01, -0.02, 0.03), expRotation({0.4, 0.9, -0.3})}, Vec3(0.05, 0.03, 0.02)};
  const Vec3 a(-0.03, 0, 0);
  const Vec3 b(0.03, 0.02, 0.01);
  const double ball = 4.0 / 3.0 * M_PI;
  return {{{box, 0.5, "box"}, 8 * 0.05 * 0.03 * 0.02, 0},
          {{SphereShape{Vec3(0.01, 0.02, 0), 0.04}, 0.5, "sphere"}, ball * 0.04 * 0.04 * 0.04, 0.04},
          {{CapsuleShape{a, b, 0.02}, 0.5, "capsule"}, ball * 8e-6 + M_PI * 4e-4 * (b - a).norm(), 0.02},
          {{CapsuleShape{a, a, 0.02}, 0.5, "capsule without length"}, ball * 8e-6, 0.02},
          {{CapsuleShape{a, a - Vec3(0, 0, 0.05), 0.02}, 0.5, "capsule upside down"}, ball * 8e-6 + M_PI * 2e-5, 0.02}};
}

double distance(const Obstacle& o, const Vec3& p) {
  return std::visit([&](const auto& shape) { return test::signedDistance(shape, p); }, o.shape);
}

TEST(Obstacle, TrianglesAreTheSolids) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (const Solid& solid : solids()) {
    const std::optional<Surface> surface = surfaceOf(solid.obstacle);
    ASSERT_TRUE(surface) << solid.obstacle.name;
    EXPECT_TRUE(inspectTopology(*surface).closed()) << solid.obstacle.name;
    // the corners lie on the solid, the triangles a few thousandths of the radius below it
    for (const Vec3& p : surface->vertices) EXPECT_NEAR(distance(solid.obstacle, p), 0.0, 1e-12) << solid.obstacle.name;
    for (const auto& t : surface->triangles) {
      const double u = uniform(random);
      const double v = uniform(random) * (1 - u);
      const Vec3 p = u * surface->vertices[t[0]] + v * surface->vertices[t[1]] + (1 - u - v) * surface->vertices[t[2]];
      EXPECT_LT(distance(solid.obstacle, p), 1e-12) << solid.obstacle.name;
      EXPECT_GT(distance(solid.obstacle, p), -2.5e-3 * solid.round - 1e-12) << solid.obstacle.name;
    }
    // outward: the volume is positive, and right
    EXPECT_NEAR(measureSurface(*surface).volume, solid.volume, 4e-3 * solid.volume) << solid.obstacle.name;
  }
}

TEST(Obstacle, PlaneNeedsNoTriangles) {
  const PlaneShape plane{Vec3(0, 0, 0.01), Vec3(1, 2, 3).normalized()};
  EXPECT_FALSE(surfaceOf({plane, 0.5, "plane"}));
  EXPECT_NEAR(gap(plane, plane.point + 0.3 * plane.normal), 0.3, 1e-15);
  EXPECT_NEAR(gap(plane, plane.point - 0.2 * plane.normal + plane.normal.unitOrthogonal()), -0.2, 1e-15);
}

}  // namespace
}  // namespace palpate
