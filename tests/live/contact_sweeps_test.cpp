#include "palpate/live/contact_sweeps.h"

#include <gtest/gtest.h>

#include <random>

namespace palpate {
namespace {

TEST(ContactSweeps, SolveFrictionProblemsWithinTheCones) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    TickContacts c;
    c.count = 1 + static_cast<int>(seed % LiveSize::kContacts);
    const Eigen::Index n = 3 * c.count;
    const MatX half = MatX::NullaryExpr(n, n + 6, [&] { return 0.01 * normal(random); });
    c.compliance = half * half.transpose();
    c.free = VecX::NullaryExpr(n, [&] { return 1e-3 * normal(random); });
    for (int i = 0; i < c.count; ++i) {
      c.normal[i] = Vec3(normal(random), normal(random), normal(random)).normalized();
      c.friction[i] = seed % 3 == 0 ? 0.0 : 0.4;
      c.gap[i] = 1e-4 * normal(random);
    }
    RowVector force = RowVector::Zero(n);
    sweep(c, 400, force);
    const VecX s = c.compliance * force + c.free;
    const double scale = 1e-6;  // [m]
    for (int i = 0; i < c.count; ++i) {
      const Vec3 f = force.segment<3>(3 * i), moved = s.segment<3>(3 * i);
      const double press = f.dot(c.normal[i]), gap = c.gap[i] + moved.dot(c.normal[i]);
      EXPECT_GE(press, -1e-12);
      EXPECT_GE(gap, -scale);
      if (press > 1e-6) {
        EXPECT_LT(std::abs(gap), scale);
      }
      const Vec3 pull = f - press * c.normal[i], slip = moved - c.normal[i].dot(moved) * c.normal[i];
      EXPECT_LE(pull.norm(), c.friction[i] * press + 1e-9);
      // what slides is pulled against its slip
      if (press > 1e-6 && c.friction[i] > 0 && slip.norm() > 1e2 * scale) {
        EXPECT_LT((pull / (c.friction[i] * press) + slip.normalized()).norm(), 0.02) << seed << ' ' << i;
      }
    }
  }
}

// What is tied comes to its place whatever the force, beside contacts that stay in their cones.
TEST(ContactSweeps, HoldWhatIsTied) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    TickContacts c;
    c.count = 2 + static_cast<int>(seed % 6);
    const Eigen::Index n = 3 * c.count;
    const MatX half = MatX::NullaryExpr(n, n + 6, [&] { return 0.01 * normal(random); });
    c.compliance = half * half.transpose();
    c.free = VecX::NullaryExpr(n, [&] { return 1e-3 * normal(random); });
    for (int i = 0; i < c.count; ++i) {
      c.normal[i] = Vec3(normal(random), normal(random), normal(random)).normalized();
      c.friction[i] = 0.4;
      c.gap[i] = 1e-4;
      c.tied[i] = i < 1 + c.count / 2;
      c.away[i] = 1e-4 * Vec3(normal(random), normal(random), normal(random));
    }
    EXPECT_TRUE(c.any());
    RowVector force = RowVector::Zero(n);
    sweep(c, 4000, force);
    const VecX s = c.compliance * force + c.free;
    for (int i = 0; i < c.count; ++i) {
      const Vec3 f = force.segment<3>(3 * i);
      if (c.tied[i]) {
        EXPECT_LT((c.away[i] + s.segment<3>(3 * i)).norm(), 1e-7) << seed << ' ' << i;
      } else {
        const double press = f.dot(c.normal[i]);
        EXPECT_LE((f - press * c.normal[i]).norm(), 0.4 * press + 1e-9);
      }
    }
  }
}

// A support pulls against the slip with what its load bears, and holds below that; its load follows the contact.
TEST(ContactSweeps, SupportsHoldAsFarAsTheirLoadBears) {
  constexpr double kPerNewton = 1e-3, kFriction = 0.5;  // [m/N]
  for (const double pushed : {2e-4, 2e-3}) {
    for (const double pressed : {0.0, 1e-3}) {
      TickContacts c;
      c.count = 2;
      c.supports = 1;
      c.compliance = kPerNewton * MatX::Identity(6, 6);
      c.free = RowVector::Zero(6);
      c.free[2] = -pressed;
      c.free[3] = pushed;
      c.normal[0] = c.normal[1] = Vec3::UnitZ();
      c.friction[0] = 0;
      c.friction[1] = kFriction;
      c.load[0] = 1.0;
      c.bearing.setZero(1, 6);
      c.bearing(0, 2) = 1.0;
      EXPECT_TRUE(c.any());
      RowVector force = RowVector::Zero(6);
      sweep(c, 100, force);
      EXPECT_NEAR(force[2], pressed / kPerNewton, 1e-9);
      EXPECT_NEAR(force[3], -std::min(pushed / kPerNewton, kFriction * (1.0 + force[2])), 1e-6);
      EXPECT_EQ(force[5], 0) << "the motions along the normal are held elsewhere";
    }
  }
}

}  // namespace
}  // namespace palpate
