#include "palpate/math/stable_norm.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <new>
#include <random>

namespace palpate {
namespace {

TEST(StableNorm, NeitherOverflowsNorUnderflows) {
  const double large = 1e300, small = 1e-310;
  EXPECT_NEAR(stableNorm(Vec3(3, -4, 12)), 13, 1e-14);
  EXPECT_NEAR(stableNorm(Vec3(3 * large, 4 * large, 0)) / large, 5, 1e-14);
  EXPECT_NEAR(stableNorm(Vec3(0, 3 * small, -4 * small)) / small, 5, 1e-9);
  EXPECT_EQ(stableNorm(Vec3::Zero()), 0);
}

TEST(StableNorm, OfWhatIsNotFinite) {
  const double infinity = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(stableNorm(Vec3(1, -infinity, 2)), infinity);
  for (int i = 0; i < 3; ++i) {
    Vec3 v(1, 2, 3);
    v[i] = nan;
    EXPECT_FALSE(stableNorm(v) == stableNorm(v));
  }
}

// Results of a run must not depend on where the stack begins; those of Eigen's stableNorm() do.
TEST(StableNorm, IsTheSameAtEveryAddress) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  alignas(64) std::array<double, 16> buffer;
  for (int k = 0; k < 1000; ++k) {
    const Vec3 v(uniform(random), uniform(random), uniform(random));
    const double norm = stableNorm(v);
    EXPECT_NEAR(norm, v.norm(), 1e-15);
    for (std::size_t offset = 0; offset < 8; ++offset) {
      EXPECT_EQ(norm, stableNorm(*new (buffer.data() + offset) Vec3(v)));
    }
  }
}

}  // namespace
}  // namespace palpate
