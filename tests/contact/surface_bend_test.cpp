#include "palpate/contact/surface_bend.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/mesh/revolution.h"
#include "palpate/mesh/shapes.h"

namespace palpate {
namespace {

// A socket with a hole of 14 mm, chamfered at its rim; axis z.
const CollisionSurface& socket() {
  static const CollisionSurface surface(revolutionSurface(
      {{0, 0}, {0.026, 0}, {0.026, 0.040}, {0.0165, 0.040}, {0.014, 0.0365}, {0.014, 0.008}, {0, 0.008}}, 64));
  return surface;
}

// Triangles that a sphere about the place meets at their vertices.
std::vector<int> near(const CollisionSurface& surface, const Vec3& place, double reach) {
  std::vector<int> out;
  for (std::size_t t = 0; t < surface.triangles().size(); ++t) {
    for (const int v : surface.triangles()[t]) {
      if ((surface.start[static_cast<std::size_t>(v)] - place).norm() < reach) {
        out.push_back(static_cast<int>(t));
        break;
      }
    }
  }
  return out;
}

TEST(SurfaceBend, IsThatOfAHolesWall) {
  for (int k = 0; k < 20; ++k) {
    const double angle = 0.013 * k;
    const Vec3 out(std::cos(angle), std::sin(angle), 0), around(-out.y(), out.x(), 0);
    const Vec3 place = 0.014 * out + Vec3(0, 0, 0.018 + 0.0003 * k);
    const Mat3 bend = surfaceBend(socket(), near(socket(), place, 0.002), place, -out);
    EXPECT_NEAR(around.dot(bend * around), -1 / 0.014, 0.05 / 0.014) << k;
    EXPECT_LT((bend - around.dot(bend * around) * around * around.transpose()).norm(), 0.02 / 0.014) << k;
  }
}

// Pushed by the rim, where the chamfer begins: the wall's bend, not the step of the crease.
TEST(SurfaceBend, StopsAtACrease) {
  const Vec3 place(0.014, 0, 0.0365), normal = Vec3(-0.98, 0, 0.2).normalized();
  const Mat3 bend = surfaceBend(socket(), near(socket(), place, 0.002), place, normal);
  EXPECT_NEAR(bend(1, 1), -1 / 0.014, 0.05 / 0.014);
  const Vec3 across = normal.cross(Vec3::UnitY());
  EXPECT_LT(std::abs(across.dot(bend * across)), 0.02 / 0.014);
}

TEST(SurfaceBend, OfWhatIsFlatIsZeroToTheBit) {
  const CollisionSurface box(boxSurface(Vec3(0.02, 0.03, 0.01), {3, 3, 3}));
  const Vec3 place(0.003, 0.014, 0.005);
  const std::vector<int> triangles = near(box, place, 0.012);
  ASSERT_FALSE(triangles.empty());
  EXPECT_TRUE(surfaceBend(box, triangles, place, Vec3::UnitZ()).isZero(0.0));
  EXPECT_TRUE(surfaceBend(box, {}, place, Vec3::UnitZ()).isZero(0.0));
}

TEST(SurfaceBend, OfABallIsRoundAndConvex) {
  const CollisionSurface ball(sphereSurface(0.02));
  // the last but for rounding at a vertex
  for (const Vec3& at : {Vec3(0.3, -0.5, 0.7), Vec3(0.3, 0.1, 0.7), Vec3(1e-17, -3e-18, 1), Vec3(-1e-17, 2e-17, 1)}) {
    const Vec3 out = at.normalized();
    const Mat3 bend = surfaceBend(ball, near(ball, 0.02 * out, 0.004), 0.02 * out, out);
    const Mat3 flat = Mat3::Identity() - out * out.transpose();
    EXPECT_LT((bend - flat / 0.02).norm(), 0.1 / 0.02) << at.transpose();
  }
}

}  // namespace
}  // namespace palpate
