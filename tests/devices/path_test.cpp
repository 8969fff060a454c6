#include "palpate/devices/path.h"

#include <gtest/gtest.h>

#include <cmath>

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
