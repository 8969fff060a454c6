#include "palpate/devices/path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "palpate/common/error.h"
#include "palpate/devices/prescribed_device.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

Path threeKeys(Interpolation interpolation) {
  return Path({{0.0, Vec3::Zero(), Vec3::Zero()},
               {1.0, Vec3(-0.4, 0.0, 0.1), Vec3(0.0, 0.5, 0.0)},
               {1.5, Vec3(-0.4, 0.2, 0.1), Vec3(0.6, 0.5, -2.0)}},
              interpolation);
}

Pose somewhere() {
  Vec6 xi;
  xi << 0.45, 0.1, -0.2, 0.3, -0.6, 1.0;
  return advance(Pose{}, xi);
}

TEST(Path, GoesStraightBetweenKeys) {
  const Path path = threeKeys(Interpolation::linear);
  const Path::Point middle = path.at(0.5, somewhere());
  EXPECT_LT((middle.pose.position - somewhere().position - Vec3(-0.2, 0.0, 0.05)).norm(), 1e-15);
  EXPECT_LT((middle.twist.head<3>() - Vec3(-0.4, 0.0, 0.1)).norm(), 1e-15);
  EXPECT_LT((logRotation(middle.pose.rotation * somewhere().rotation.conjugate()) - Vec3(0, 0.25, 0)).norm(), 1e-14);
}

TEST(Path, VelocityAtAKeyIsTheRightHandOne) {
  const Path path = threeKeys(Interpolation::linear);
  for (const double early : {0.0, 0.9e-9, -0.9e-9}) {
    const Path::Point at = path.at(1.0 - early, Pose{});
    EXPECT_EQ(Vec3(at.twist.head<3>()), Vec3(0.0, 0.4, 0.0));
    EXPECT_LT((at.pose.position - Vec3(-0.4, 0.0, 0.1)).norm(), 1e-9);
  }
  EXPECT_EQ(path.at(1.0 - 2e-9, Pose{}).twist[0], -0.4);
  EXPECT_EQ(path.at(0.0, Pose{}).twist[0], -0.4);
  EXPECT_EQ(path.at(1.5, Pose{}).twist, Vec6(Vec6::Zero()));
}

TEST(Path, RestsOutsideItsKeys) {
  const Path path({{0.5, Vec3(1, 0, 0), Vec3::Zero()}, {1.0, Vec3(2, 0, 0), Vec3::Zero()}});
  EXPECT_EQ(path.at(0.0, Pose{}).pose.position.x(), 1.0);
  EXPECT_EQ(path.at(0.0, Pose{}).twist, Vec6(Vec6::Zero()));
  EXPECT_EQ(path.at(9.0, Pose{}).pose.position.x(), 2.0);
  EXPECT_EQ(Path().at(3.0, somewhere()).pose.position, somewhere().position);
  EXPECT_EQ(path.duration(), 1.0);
}

TEST(Path, TwistIsTheDerivativeOfThePose) {
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::smooth}) {
    const Path path = threeKeys(interpolation);
    const double step = 1e-5;
    for (const double t : {0.1, 0.5, 0.77, 1.2, 1.43}) {
      const Vec6 numeric =
          poseDifference(path.at(t + step, somewhere()).pose, path.at(t - step, somewhere()).pose) / (2.0 * step);
      EXPECT_LT((numeric - path.at(t, somewhere()).twist).norm(), 1e-8) << t;
    }
  }
}

TEST(Path, SmoothOneRestsInItsKeys) {
  const Path path = threeKeys(Interpolation::smooth);
  for (const double t : {0.0, 1.0, 1.5}) {
    EXPECT_LT(path.at(t, Pose{}).twist.norm(), 1e-12);
    EXPECT_LT((path.at(t + 1e-6, Pose{}).twist - path.at(t, Pose{}).twist).norm(), 1e-4);
  }
  EXPECT_NEAR(path.at(0.5, Pose{}).twist[0], -0.4 * 15.0 / 8.0, 1e-12);
}

// Random motion on top of the keys: of the size asked for, nothing of it outside its time, the same for a seed, and
// without what is faster than its band.
TEST(Path, WandersWithinItsBand) {
  Wander wander{5.0, Vec3(0.01, 0, 0.002), Vec3(0, 0.1, 0), 1.0, 201.0, 3};
  const Path path({{0.0, Vec3::Zero(), Vec3::Zero()}}, Interpolation::smooth, wander);
  const auto offset = [&](double t) { return poseDifference(path.at(t, Pose{}).pose, Pose{}); };
  for (const double t : {0.0, 1.0, 201.0, 300.0}) {
    EXPECT_EQ(offset(t).norm(), 0) << t;
    EXPECT_EQ(path.at(t, Pose{}).twist.norm(), 0) << t;
  }
  constexpr double kStep = 1e-5;
  for (const double t : {1.02, 1.3, 57.0, 200.7, 200.99}) {
    const Vec6 numeric =
        poseDifference(path.at(t + kStep, Pose{}).pose, path.at(t - kStep, Pose{}).pose) / (2.0 * kStep);
    EXPECT_LT((numeric - path.at(t, Pose{}).twist).norm(), 1e-7) << t;
  }
  constexpr int kSamples = 19000;  // of 10 ms, without the ends
  Vec6 square = Vec6::Zero();
  std::vector<double> along;
  for (int k = 0; k < kSamples; ++k) {
    const Vec6 o = offset(5.0 + 0.01 * k);
    square += o.cwiseAbs2() / kSamples;
    along.push_back(o[0]);
  }
  EXPECT_NEAR(std::sqrt(square[0]), 0.01, 5e-4);
  EXPECT_NEAR(std::sqrt(square[2]), 0.002, 1e-4);
  EXPECT_NEAR(std::sqrt(square[4]), 0.1, 5e-3);
  EXPECT_EQ(square[1] + square[3] + square[5], 0);
  const auto at = [&](double frequency) {
    std::complex<double> sum = 0;
    for (int k = 0; k < kSamples; ++k) {
      const double window = 0.5 - 0.5 * std::cos(2 * std::numbers::pi * k / kSamples);
      sum +=
          window * along[static_cast<std::size_t>(k)] * std::polar(1.0, -2 * std::numbers::pi * frequency * 0.01 * k);
    }
    return std::abs(sum) / kSamples;
  };
  double within = 0, beyond = 0;
  for (double f = 0.0; f < 5.0; f += 0.004) within = std::max(within, at(f));
  for (double f = 5.1; f < 20.0; f += 0.05) beyond = std::max(beyond, at(f));
  EXPECT_GT(within, 1e-3);
  EXPECT_LT(beyond, 1e-6);
  wander.seed = 4;
  EXPECT_GT((Path({}, Interpolation::smooth, wander).at(60, Pose{}).pose.position - offset(60).head<3>()).norm(), 1e-4);
}

TEST(Path, RejectsBadKeys) {
  EXPECT_THROW(Path({{0.0, Vec3::Zero(), Vec3::Zero()}, {0.0, Vec3::Zero(), Vec3::Zero()}}), InputError);
  EXPECT_THROW(Path({{std::nan(""), Vec3::Zero(), Vec3::Zero()}}), InputError);
  EXPECT_THROW(Path({{0.0, Vec3(0, INFINITY, 0), Vec3::Zero()}}), InputError);
}

TEST(PrescribedDevice, FollowsWhateverItFeels) {
  PrescribedDevice device(threeKeys(Interpolation::linear), somewhere());
  device.apply(Vec6::Constant(100.0), 0.0, 0.001);
  const Path::Point point = threeKeys(Interpolation::linear).at(0.3, somewhere());
  EXPECT_EQ(device.sample(0.3).pose.position, point.pose.position);
  EXPECT_EQ(device.sample(0.3).twist, point.twist);
}

}  // namespace
}  // namespace palpate
