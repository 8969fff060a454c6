#include "palpate/live/surface_touch.h"

#include <gtest/gtest.h>

#include <random>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

struct Example {
  LiveSurface surface;
  Mat3 rotation;
  Vec3 place;
};

// A flat tool of random extent over a ball, a capsule or a bent plane, turned by up to 5 degrees from lying on it.
Example example(int seed, LiveSurface::Kind kind, int directions) {
  std::mt19937 random(static_cast<unsigned>(seed));
  std::uniform_real_distribution<double> some(-1, 1);
  const auto any = [&] { return Vec3(some(random), some(random), some(random)); };
  Example e;
  e.rotation = expRotation(0.05 * any()).toRotationMatrix();
  const double radius = 0.02 + 0.01 * some(random);
  LiveSurface& s = e.surface;
  s.kind = kind;
  s.normal = Vec3::UnitZ();
  if (kind == LiveSurface::Kind::plane) {
    s.bend = Vec3(directions == 2 ? 1 / radius : 0, 1 / radius, 0).asDiagonal();
  } else {
    s.offset = radius;
    s.a = s.b = Vec3(0, 0, -radius);
    if (directions == 1) {
      s.a.x() = -0.1;
      s.b.x() = 0.1;
    }
  }
  e.place = Vec3(0.004, 0.004, 0.0005).cwiseProduct(any());
  s.flat_directions = directions;
  for (int k = 0; k < directions; ++k) {
    s.flat[static_cast<std::size_t>(k)] = {k == 0 ? Vec3::UnitY() : Vec3::UnitX(), -0.01 * std::abs(some(random)),
                                           0.01 * std::abs(some(random))};
  }
  return e;
}

double gapAt(const Example& e, const Vec3& way) { return touch(e.surface, e.place + e.rotation * way).gap; }

// No place of the flat piece is nearer than the one that is found.
TEST(SurfaceTouch, SlidesToTheNearestPlace) {
  using Kind = LiveSurface::Kind;
  for (const auto& [kind, directions] :
       {std::pair{Kind::capsule, 1}, {Kind::capsule, 2}, {Kind::plane, 1}, {Kind::plane, 2}}) {
    int moved = 0;
    for (int seed = 0; seed < 200; ++seed) {
      const Example e = example(seed, kind, directions);
      const Vec3 way = slideAlongFlat(e.surface, e.rotation, e.place);
      double best = 1e300;
      const auto& f = e.surface.flat;
      constexpr int kSteps = 40;
      for (int i = 0; i <= kSteps; ++i) {
        for (int j = 0; j <= (directions == 2 ? kSteps : 0); ++j) {
          Vec3 other = (f[0].least + i * (f[0].greatest - f[0].least) / kSteps) * f[0].direction;
          if (directions == 2) other += (f[1].least + j * (f[1].greatest - f[1].least) / kSteps) * f[1].direction;
          best = std::min(best, gapAt(e, other));
        }
      }
      // of a bent plane the gap is not quite the distance; one direction after the other is not quite both at once
      EXPECT_LT(gapAt(e, way), best + (kind == Kind::plane ? 6e-5 : directions == 2 ? 3e-5 : 1e-9)) << seed;
      for (int k = 0; k < directions; ++k) {
        const LiveSurface::Flat& flat = f[static_cast<std::size_t>(k)];
        EXPECT_GE(way.dot(flat.direction), flat.least - 1e-15);
        EXPECT_LE(way.dot(flat.direction), flat.greatest + 1e-15);
      }
      moved += way.norm() > 1e-4 ? 1 : 0;
    }
    EXPECT_GT(moved, 150);
  }
}

TEST(SurfaceTouch, StaysWhereNothingIsNearer) {
  LiveSurface s;
  s.flat_directions = 1;
  s.flat[0] = {Vec3::UnitX(), -1, 1};
  EXPECT_TRUE(slideAlongFlat(s, Mat3::Identity(), Vec3(0, 0, 1)).isZero(0.0));  // a plane
  s.bend = Vec3(-50, -50, 0).asDiagonal();                                      // a hollow
  EXPECT_TRUE(slideAlongFlat(s, Mat3::Identity(), Vec3(0.01, 0, 1)).isZero(0.0));
  s.kind = LiveSurface::Kind::capsule;  // along its axis
  s.a = Vec3(-1, 0, 0);
  s.b = Vec3(1, 0, 0);
  EXPECT_TRUE(slideAlongFlat(s, Mat3::Identity(), Vec3(0.2, 0, 1)).isZero(0.0));
}

}  // namespace
}  // namespace palpate
