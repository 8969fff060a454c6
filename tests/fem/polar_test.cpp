// The Newton polar rotation against singular values, for any matrix and any guess.
#include "palpate/fem/polar.h"

#include <gtest/gtest.h>
#include <Eigen/SVD>

#include <cstring>
#include <random>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

Mat3 randomRotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Quat(normal(random), normal(random), normal(random), normal(random)).normalized().toRotationMatrix();
}

// U diag(s) V^T with given singular values; its rotation is U V^T if det > 0.
struct Sample {
  Mat3 f, rotation;
};
Sample sample(std::mt19937& random, const Vec3& stretch) {
  const Mat3 u = randomRotation(random);
  const Mat3 v = randomRotation(random);
  return {u * stretch.asDiagonal() * v.transpose(), u * v.transpose()};
}

void expectRotation(const Mat3& r) {
  EXPECT_LT((r.transpose() * r - Mat3::Identity()).norm(), 1e-12);
  EXPECT_NEAR(r.determinant(), 1.0, 1e-12);
}

TEST(Polar, FindsTheRotationFromAnyGuess) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> stretch(0.2, 3.0);
  for (int n = 0; n < 2000; ++n) {
    const Sample s = sample(random, Vec3(stretch(random), stretch(random), stretch(random)));
    const Mat3 r = polarRotation(s.f, n % 3 == 0 ? Mat3(Mat3::Identity()) : randomRotation(random));
    expectRotation(r);
    EXPECT_LT((r - s.rotation).norm(), 1e-12);
  }
}

// det F < 0: the nearest proper rotation flips the smallest stretch. U diag(a, b, -c) V^T with c smallest has U V^T.
TEST(Polar, InvertedGivesTheNearestProperRotation) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> large(0.5, 2.0);
  std::uniform_real_distribution<double> small(0.05, 0.4);
  for (int n = 0; n < 2000; ++n) {
    const Sample s = sample(random, Vec3(large(random), large(random), -small(random)));
    const Mat3 r = polarRotation(s.f, randomRotation(random));
    expectRotation(r);
    EXPECT_LT((r - s.rotation).norm(), 1e-11);
  }
}

// Collapsed to a plane the rotation is still unique; to a line, a point, or with equal stretches of opposite sign it is
// not: any that maximizes tr(R^T F), whose maximum is s1 + s2 +- s3.
TEST(Polar, SingularMatricesGiveAMaximizer) {
  std::mt19937 random(3);
  const Vec3 stretches[] = {{1.0, 0.7, 0.0},     {1.0, 0.0, 0.0},    {0.0, 0.0, 0.0},  {1.0, 0.3, -0.3},
                            {1.0, 1e-14, 1e-14}, {1e-9, 1e-9, 1e-9}, {1.0, 1.0, -1.0}, {1e9, 2e9, 3e9}};
  for (const Vec3& stretch : stretches) {
    for (int n = 0; n < 200; ++n) {
      const Sample s = sample(random, stretch);
      const Mat3 r = polarRotation(s.f, randomRotation(random));
      expectRotation(r);
      EXPECT_NEAR((r.transpose() * s.f).trace(), stretch.sum(), 1e-11 * stretch.cwiseAbs().maxCoeff());
    }
  }
}

TEST(Polar, HessianIsTheDerivativeOfTheAxialVector) {
  std::mt19937 random(4);
  const Sample s = sample(random, Vec3(1.3, 0.8, 0.6));
  const Mat3 r = s.rotation * expRotation({0.1, -0.2, 0.05}).toRotationMatrix();
  const auto axial = [&](const Vec3& omega) {
    const Mat3 g = (r * expRotation(omega).toRotationMatrix()).transpose() * s.f;
    return Vec3(g(2, 1) - g(1, 2), g(0, 2) - g(2, 0), g(1, 0) - g(0, 1));
  };
  // turning the frame by omega takes H omega off the axial vector, up to the axial vector's own half turn
  const Vec3 at = axial(Vec3::Zero());
  for (int k = 0; k < 3; ++k) {
    const Vec3 d = 1e-5 * Vec3::Unit(k);
    const Vec3 slope = (axial(d) - axial(-d)) / 2e-5;
    const Vec3 expected = -polarHessian(r, s.f).col(k) + 0.5 * at.cross(Vec3(Vec3::Unit(k)));
    EXPECT_LT((slope - expected).norm(), 1e-9) << k;
  }
}

// A long chain of small turns must not let the matrix drift from orthogonality.
TEST(Polar, StaysOrthogonalOverManySteps) {
  Mat3 r = Mat3::Identity();
  const Mat3 turn = expRotation({0.01, 0.02, -0.03}).toRotationMatrix();
  Mat3 f = Vec3(1.2, 0.9, 1.0).asDiagonal();
  for (int n = 0; n < 20000; ++n) {
    if (n % 100 == 0) f = r * Vec3(1.2, 0.9, 1.0).asDiagonal();
    f = turn * f;
    r = polarRotation(f, r);
  }
  EXPECT_LT((r.transpose() * r - Mat3::Identity()).norm(), 1e-10);
}

// Easy ones, turned over and collapsed, side by side, each from a guess that is right, near or far off.
TEST(Polar, FourAtOnceAreThoseOfEachToTheBit) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> large(0.5, 2.0), angle(-1, 1);
  const auto pick = [&](int most) { return std::uniform_int_distribution<int>(0, most)(random); };
  for (int n = 0; n < 3000; ++n) {
    std::array<Mat3, 4> f, one, four;
    std::array<Mat3*, 4> rotation{};
    for (int k = 0; k < 4; ++k) {
      const int kind = pick(9);
      const Sample s = sample(random, {large(random), large(random),
                                       kind == 0   ? -0.3
                                       : kind == 1 ? 0.0
                                                   : large(random)});
      f[k] = s.f;
      const double off = std::array{0.0, 1e-6, 0.05, 1.5}[static_cast<std::size_t>(pick(3))];
      one[k] = four[k] = s.rotation * expRotation(off * Vec3(angle(random), angle(random), angle(random))).matrix();
      rotation[k] = &four[k];
    }
    polarRotations(f, rotation);
    for (int k = 0; k < 4; ++k) {
      one[k] = polarRotation(f[k], one[k]);
      EXPECT_EQ(std::memcmp(one[k].data(), four[k].data(), sizeof(Mat3)), 0) << n << "\n" << f[k];
    }
  }
}

}  // namespace
}  // namespace palpate
