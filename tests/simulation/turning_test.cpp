// A body that is linearized where it turns to.
#include <gtest/gtest.h>

#include "shared/held_scenes.h"

namespace palpate::test {
namespace {

// Free, by a third of a radian in each of thirty steps of 33 ms: it keeps its shape but for the centrifugal load, its
// energy and, nearly, its angular momentum, which drifts most where it tumbles. Along straight ways it would grow by a
// twentieth in each step.
TEST(Turning, AFreeBarKeepsItsEnergyAndItsShape) {
  struct Case {
    Vec3 turning;
    double drift;
  };
  Material material;
  material.youngs_modulus = 2e4;
  for (const auto& [turning, drift] : {Case{{0, 0, 10}, 0.05}, Case{{0.2, 10, 0.2}, 0.08}, Case{{6, 0.2, 8}, 0.3}}) {
    Vec6 twist;
    twist << 0.1, 0, 0, turning;
    const BodyModel bar("thrown", barMesh(Vec3(0.06, 0.03, 0.1), {4, 2, 6}), material, 0.5, twist);
    const VecX& mass = bar.elasticity().mass();
    BodySystem system(bar);
    BodyState state = bar.startState();
    const auto momentum = [&] {
      Vec3 center = Vec3::Zero(), sum = Vec3::Zero();
      for (Eigen::Index i = 0; i < mass.size(); ++i) center += mass[i] / mass.sum() * state.positions.segment<3>(3 * i);
      for (Eigen::Index i = 0; i < mass.size(); ++i) {
        sum += mass[i] * (state.positions.segment<3>(3 * i) - center).cross(state.velocities.segment<3>(3 * i));
      }
      return sum;
    };
    const Vec3 before = momentum();
    const double energy = bar.kineticEnergy(state);
    StepInput input;
    input.gravity.setZero();
    for (int k = 0; k < 30; ++k) {
      SCOPED_TRACE(testing::Message() << turning.transpose() << ", step " << k);
      system.assemble(input, state, nullptr, true);
      if (!system.contactNodesFit({})) system.orderContactNodes({});
      ASSERT_TRUE(system.factorize());
      system.solveFree();
      ASSERT_TRUE(system.advance());
      const double moving = bar.kineticEnergy(state), elastic = system.elasticEnergy(state, 0.0);
      EXPECT_GT(moving, 0.98 * energy);
      EXPECT_LT(moving + elastic, 1.005 * energy);
      EXPECT_LT(elastic, 0.01 * energy);
    }
    EXPECT_LT((momentum() - before).norm(), drift * before.norm()) << turning.transpose();
  }
}

}  // namespace
}  // namespace palpate::test
