// Exponential, logarithm and Jacobians of SO(3) against Eigen and central differences, from tiny angles to pi.
#include "palpate/math/rotation.h"

#include <gtest/gtest.h>

#include <random>

namespace palpate {
namespace {

const double kAngles[] = {0.0, 1e-9, 1e-6, 9e-5, 1.1e-4, 9e-4, 1.1e-3, 0.01, 0.3, 1.0, 2.0, 3.0, 3.14};

Vec3 randomUnit(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Vec3(normal(random), normal(random), normal(random)).normalized();
}

TEST(Rotation, ExponentialIsEigensAngleAxis) {
  std::mt19937 random(1);
  for (const double angle : kAngles) {
    const Vec3 axis = randomUnit(random);
    const Mat3 expected = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    EXPECT_LT((expRotation(angle * axis).toRotationMatrix() - expected).norm(), 1e-14) << angle;
  }
}

TEST(Rotation, LogarithmInvertsTheExponential) {
  std::mt19937 random(2);
  for (const double angle : kAngles) {
    const Vec3 theta = angle * randomUnit(random);
    EXPECT_LT((logRotation(expRotation(theta)) - theta).norm(), 1e-13 + 1e-14 * angle) << angle;
    Quat other = expRotation(theta);
    other.coeffs() *= -1.0;  // the same rotation
    EXPECT_LT((logRotation(other) - theta).norm(), 1e-13) << angle;
  }
}

TEST(Rotation, LogarithmTakesTheShorterWayBeyondPi) {
  const Vec3 axis = Vec3(1, -2, 0.5).normalized();
  const Vec3 theta = logRotation(expRotation((M_PI + 0.1) * axis));
  EXPECT_LT((theta + (M_PI - 0.1) * axis).norm(), 1e-12);
}

// Central differences of the defining relations; their error is the square of the step over angles of order one.
TEST(Rotation, JacobiansAreTheDerivatives) {
  std::mt19937 random(3);
  constexpr double kStep = 1e-5;
  for (const double angle : kAngles) {
    const Vec3 theta = angle * randomUnit(random);
    const Quat inverse = expRotation(theta).conjugate();
    Mat3 left, log;
    for (int k = 0; k < 3; ++k) {
      const Vec3 d = kStep * Vec3::Unit(k);
      left.col(k) =
          (logRotation(expRotation(theta + d) * inverse) - logRotation(expRotation(theta - d) * inverse)) / (2 * kStep);
      log.col(k) =
          (logRotation(expRotation(d) * expRotation(theta)) - logRotation(expRotation(-d) * expRotation(theta))) /
          (2 * kStep);
    }
    EXPECT_LT((leftJacobian(theta) - left).norm(), 1e-8) << angle;
    EXPECT_LT((leftJacobian(theta) * leftJacobianInverse(theta) - Mat3::Identity()).norm(), 1e-11) << angle;
    if (angle > 3.1) continue;  // differences would cross the cut at pi
    EXPECT_LT((leftJacobianInverse(theta) - log).norm(), 1e-8) << angle;
  }
}

TEST(Rotation, PoseDifferenceInvertsAdvance) {
  Pose pose{Vec3(0.1, -0.2, 0.3), expRotation({0.4, 1.0, -0.7})};
  Vec6 xi;
  xi << 0.01, 0.02, -0.03, 0.5, -1.1, 0.9;
  EXPECT_LT((poseDifference(advance(pose, xi), pose) - xi).norm(), 1e-14);
}

TEST(Rotation, SkewIsTheCrossProduct) {
  const Vec3 a(1, 2, 3), b(-0.5, 4, 0.1);
  EXPECT_LT((skew(a) * b - a.cross(b)).norm(), 1e-15);
}

}  // namespace
}  // namespace palpate
