#include "palpate/contact/flat_piece.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/mesh/shapes.h"

namespace palpate {
namespace {

// The triangle that a line down through (x, y) meets first.
int topTriangle(const CollisionSurface& s, double x, double y) {
  for (std::size_t t = 0; t < s.triangles().size(); ++t) {
    const auto& v = s.triangles()[t];
    const auto at = [&](std::size_t k) -> const Vec3& { return s.start[static_cast<std::size_t>(v[k])]; };
    if (!(s.areaNormal(static_cast<int>(t), 0).normalized().z() > 0.9)) continue;
    bool inside = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 &p = at(k), &q = at((k + 1) % 3);
      inside = inside && (q.x() - p.x()) * (y - p.y()) - (q.y() - p.y()) * (x - p.x()) >= 0;
    }
    if (inside) return static_cast<int>(t);
  }
  return -1;
}

double least(const CollisionSurface& s, int axis) {
  double low = 1e300;
  for (const Vec3& x : s.start) low = std::min(low, x[axis]);
  return low;
}
double greatest(const CollisionSurface& s, int axis) {
  double high = -1e300;
  for (const Vec3& x : s.start) high = std::max(high, x[axis]);
  return high;
}

// A face of many triangles reaches from rim to rim, along any line, also along the rim itself.
TEST(FlatPiece, ReachesFromRimToRim) {
  const CollisionSurface box(boxSurface(Vec3(0.08, 0.04, 0.02), {5, 3, 2}));
  const double x0 = least(box, 0), x1 = greatest(box, 0), y0 = least(box, 1), y1 = greatest(box, 1);
  const double top = greatest(box, 2);
  const int t = topTriangle(box, 0.5 * (x0 + x1) + 0.007, 0.5 * (y0 + y1) + 0.003);
  ASSERT_GE(t, 0);
  const FlatPiece piece(box, std::array{t}, Vec3::UnitZ());
  EXPECT_LT((piece.normal() - Vec3::UnitZ()).norm(), 1e-12);
  EXPECT_NEAR(piece.along().dot(piece.normal()), 0, 1e-12);
  const Vec3 place(x0 + 0.03, y0 + 0.011, top);
  const auto [a, b] = piece.extent(place, Vec3::UnitX());
  EXPECT_NEAR(a, -0.03, 2e-5);
  EXPECT_NEAR(b, x1 - x0 - 0.03, 2e-5);
  const Vec3 slanted = Vec3(1, 1, 0).normalized();
  const auto [c, d] = piece.extent(place, slanted);
  EXPECT_NEAR(c, -0.011 * std::sqrt(2.0), 5e-5);
  EXPECT_NEAR(d, (y1 - y0 - 0.011) * std::sqrt(2.0), 5e-5);
  const auto [e, f] = piece.extent(Vec3(x0 + 0.01, y1, top), Vec3::UnitX());  // the rim
  EXPECT_NEAR(e, -0.01, 2e-5);
  EXPECT_NEAR(f, x1 - x0 - 0.01, 2e-5);
  const auto [g, h] = piece.extent(Vec3(x0 - 0.01, y0 + 0.011, top), Vec3::UnitX());  // beside it
  EXPECT_EQ(g, 0);
  EXPECT_EQ(h, 0);
}

// At an edge, the side that faces as it is asked for; what is round has no more than its facets.
TEST(FlatPiece, TakesTheSideThatFacesAndEndsAtBends) {
  const CollisionSurface box(boxSurface(Vec3(0.08, 0.04, 0.02), {1, 1, 1}));
  std::vector<int> all;
  for (std::size_t t = 0; t < box.triangles().size(); ++t) all.push_back(static_cast<int>(t));
  for (const Vec3& facing : {Vec3(0.3, 0.1, 1), Vec3(-1, 0.2, 0.5), Vec3(0, -1, 0.9)}) {
    const Vec3 n = FlatPiece(box, all, facing).normal();
    EXPECT_GT(n.dot(facing.normalized()), 0.7);
    EXPECT_NEAR(n.cwiseAbs().maxCoeff(), 1, 1e-12);
  }
  const CollisionSurface ball(sphereSurface(0.02));
  const FlatPiece facet(ball, std::array{0}, ball.areaNormal(0, 0));
  const auto& v = ball.triangles()[0];
  Vec3 middle = Vec3::Zero();
  for (const int i : v) middle += ball.start[static_cast<std::size_t>(i)] / 3;
  const auto [a, b] = facet.extent(middle, facet.along());
  EXPECT_LT(a, 0);
  EXPECT_GT(b, 0);
  EXPECT_LT(b - a, 0.01);
  EXPECT_TRUE(FlatPiece(ball, {}, Vec3::UnitZ()).normal().isZero(0.0));
}

}  // namespace
}  // namespace palpate
