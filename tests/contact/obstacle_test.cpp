// Signed distances against brute force and finite differences.
#include "palpate/contact/obstacle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

std::vector<Obstacle> shapes() {
  const BoxShape box{{Vec3(0.01, -0.02, 0.03), expRotation({0.4, 0.9, -0.3})}, Vec3(0.05, 0.03, 0.02)};
  return {{PlaneShape{Vec3(0, 0, 0.01), Vec3(1, 2, 3).normalized()}, 0.5, "plane"},
          {box, 0.5, "box"},
          {SphereShape{Vec3(0.01, 0.02, 0), 0.04}, 0.5, "sphere"},
          {CapsuleShape{Vec3(-0.03, 0, 0), Vec3(0.03, 0.02, 0.01), 0.02}, 0.5, "capsule"},
          {CapsuleShape{Vec3(0.01, 0, 0), Vec3(0.01, 0, 0), 0.02}, 0.5, "capsule without length"}};
}

// The normal is the gradient wherever the gap is differentiable; near the inner skeleton differences straddle a kink.
TEST(Obstacle, NormalIsTheGapsGradient) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-0.1, 0.1);
  constexpr double kStep = 1e-6;
  for (const Obstacle& o : shapes()) {
    int kinks = 0;
    for (int n = 0; n < 2000; ++n) {
      const Vec3 p(uniform(random), uniform(random), uniform(random));
      const Proximity at = proximity(o, p);
      EXPECT_NEAR(at.normal.norm(), 1.0, 1e-12) << o.name;
      Vec3 gradient;
      for (int k = 0; k < 3; ++k) {
        const Vec3 d = kStep * Vec3::Unit(k);
        gradient[k] = (proximity(o, p + d).gap - proximity(o, p - d).gap) / (2 * kStep);
      }
      if ((gradient - at.normal).norm() > 1e-4) ++kinks;
    }
    EXPECT_LE(kinks, 2) << o.name;
  }
}

// The nearest surface point lies at p - gap n: the gap there is zero, outside as inside.
TEST(Obstacle, GapLeadsToTheSurface) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-0.1, 0.1);
  for (const Obstacle& o : shapes()) {
    for (int n = 0; n < 2000; ++n) {
      const Vec3 p(uniform(random), uniform(random), uniform(random));
      const Proximity at = proximity(o, p);
      EXPECT_NEAR(proximity(o, p - at.gap * at.normal).gap, 0.0, 1e-14) << o.name;
    }
  }
}

TEST(Obstacle, BoxDistanceIsThatOfTheNearestPoint) {
  const BoxShape box{{Vec3(0.01, -0.02, 0.03), expRotation({0.4, 0.9, -0.3})}, Vec3(0.05, 0.03, 0.02)};
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-0.12, 0.12);
  for (int n = 0; n < 1000; ++n) {
    const Vec3 local(uniform(random), uniform(random), uniform(random));
    const Vec3 clamped = local.cwiseMax(-box.half_extents).cwiseMin(box.half_extents);
    const double outside = (local - clamped).norm();
    const double inside = (local.cwiseAbs() - box.half_extents).maxCoeff();
    const Proximity at = proximity({box, 0.5, ""}, box.pose.apply(local));
    EXPECT_NEAR(at.gap, outside > 0 ? outside : inside, 1e-15);
  }
}

TEST(Obstacle, SkeletonsGiveAUnitNormal) {
  EXPECT_DOUBLE_EQ(proximity({SphereShape{}, 0.5, ""}, Vec3::Zero()).normal.norm(), 1.0);
  EXPECT_DOUBLE_EQ(proximity({CapsuleShape{}, 0.5, ""}, Vec3(0.5, 0, 0)).normal.norm(), 1.0);
  const Proximity middle = proximity({BoxShape{}, 0.5, ""}, Vec3::Zero());
  EXPECT_DOUBLE_EQ(middle.normal.norm(), 1.0);
  EXPECT_DOUBLE_EQ(middle.gap, -0.05);
}

}  // namespace
}  // namespace palpate
