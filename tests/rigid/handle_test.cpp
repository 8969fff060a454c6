// The handle's mass, center and kinematics against sums over points.
#include "palpate/rigid/handle.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"
#include "palpate/rigid/link.h"

namespace palpate {
namespace {

const std::vector<int> kNodes{4, 7, 9, 12};
const std::vector<Vec3> kPositions{{0.1, 0, 0.2}, {0.13, 0.02, 0.2}, {0.1, 0.03, 0.24}, {0.09, -0.01, 0.21}};
const std::vector<double> kMasses{0.01, 0.02, 0.005, 0.015};
const Vec3 kInertia(1e-5, 2e-5, 3e-5);

Handle sampleHandle() {
  return makeHandle("h", kNodes, kPositions, kMasses, 0.03, kInertia, expRotation({0.5, -1, 2}));
}

TEST(Handle, OriginIsTheCenterOfMassAndNodesKeepTheirPlaces) {
  const Handle h = sampleHandle();
  EXPECT_DOUBLE_EQ(h.mass, 0.08);
  EXPECT_DOUBLE_EQ(h.attached_mass, 0.05);
  Vec3 moment = Vec3::Zero();
  for (int k = 0; k < 4; ++k) {
    EXPECT_LT((h.nodePosition(k, h.start.pose) - kPositions[k]).norm(), 1e-15);
    moment += kMasses[k] * (kPositions[k] - h.start.pose.position);
  }
  EXPECT_LT(moment.norm(), 1e-16);
}

// Kinetic energy of the mass matrix = that of the points + the handle's own, for any twist and pose.
TEST(Handle, MassMatrixGivesTheKineticEnergyOfThePoints) {
  Handle h = sampleHandle();
  h.start.pose.rotation = expRotation({-0.4, 0.2, 1.2});
  h.start.twist << 0.3, -0.1, 0.2, 2.0, -3.0, 1.0;
  const Vec3 spin = h.start.pose.rotation.conjugate() * Vec3(h.start.twist.tail<3>());
  double energy = 0.5 * 0.03 * h.start.twist.head<3>().squaredNorm() + 0.5 * spin.dot(kInertia.cwiseProduct(spin));
  for (int k = 0; k < 4; ++k) energy += 0.5 * kMasses[k] * h.nodeVelocity(k, h.start).squaredNorm();
  EXPECT_NEAR(0.5 * h.start.twist.dot(h.massMatrix(h.start.pose) * h.start.twist), energy, 1e-14);
}

TEST(Handle, JacobianIsTheDerivativeOfANodesPosition) {
  Handle h = sampleHandle();
  const Pose pose = h.start.pose;
  for (int k = 0; k < 4; ++k) {
    const auto jacobian = h.jacobian(k, h.start.pose);
    for (int c = 0; c < 6; ++c) {
      const Vec6 d = 1e-6 * Vec6::Unit(c);
      const Vec3 slope = (advance(pose, d).apply(h.offsets[k]) - advance(pose, -d).apply(h.offsets[k])) / 2e-6;
      EXPECT_LT((jacobian.col(c) - slope).norm(), 1e-9);
    }
    h.start.twist << 1, 2, 3, 4, 5, 6;
    EXPECT_LT((h.nodeVelocity(k, h.start) - jacobian * h.start.twist).norm(), 1e-14);
  }
}

TEST(Handle, RefusesEmptyRegionsAndNoMass) {
  EXPECT_THROW(makeHandle("h", {}, {}, {}, 0.03, kInertia, Quat::Identity()), InputError);
  for (const double mass : {0.0, -1.0, std::nan("")}) {
    EXPECT_THROW(makeHandle("h", kNodes, kPositions, kMasses, mass, kInertia, Quat::Identity()), InputError);
  }
}

TEST(Handle, MasslessNodesAreCenteredOnTheirMiddle) {
  const Handle h = makeHandle("h", kNodes, kPositions, {0, 0, 0, 0}, 0.03, Vec3::Zero(), Quat::Identity());
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : kPositions) middle += 0.25 * p;
  EXPECT_LT((h.start.pose.position - middle).norm(), 1e-15);
  EXPECT_GT(h.inertia.diagonal().minCoeff(), 0.0);
}

TEST(Link, ActsOnTheDeviceTowardsTheHandle) {
  const LinkParameters link{100, 2, 3, 0.5};
  Pose handle{Vec3(0.01, 0, 0), expRotation({0, 0.1, 0})};
  Vec6 twist;
  twist << 0, 0.2, 0, 0, 0, 1;
  Vec6 expected;
  expected << 1.0, 0.4, 0, 0, 0.3, 0.5;
  EXPECT_LT((linkWrenchOnDevice(link, handle, twist, Pose{}, Vec6::Zero()) - expected).norm(), 1e-14);
}

// Each of spring and damper by itself, in its own direction, in force and in torque.
TEST(Link, Saturates) {
  LinkParameters link{100, 2, 3, 0.5};
  const Pose handle{Vec3(0.03, 0, 0), expRotation({0, 0.1, 0})};
  Vec6 twist;
  twist << 0, 0.2, 0, 0, 0, 1;
  const auto wrench = [&] { return saturatedWrenchOnDevice(link, handle, twist, Pose{}, Vec6::Zero()); };
  const Vec6 whole = wrench();
  EXPECT_EQ(whole, linkWrenchOnDevice(link, handle, twist, Pose{}, Vec6::Zero()));
  link.peak_force = 1.0;
  link.peak_torque = 0.4;
  Vec6 expected;
  expected << 1.0, 0.4, 0, 0, 0.3, 0.4;  // the spring's 3 N and the damper's 0.5 N m are too many
  EXPECT_LT((wrench() - expected).norm(), 1e-14);
}

}  // namespace
}  // namespace palpate
