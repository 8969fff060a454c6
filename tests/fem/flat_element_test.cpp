// What a tetrahedron resists that is pressed flat or turned over.
#include "palpate/fem/flat_element.h"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <random>

#include "palpate/fem/elastic_mesh.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/shapes.h"

namespace palpate {
namespace {

SimulationMesh oneTetrahedron() {
  TetrahedralMesh mesh{{Vec3(0, 0, 0), Vec3(0.02, 0.001, 0), Vec3(0.003, 0.02, 0), Vec3(0.001, 0.004, 0.02)},
                       {{0, 1, 2, 3}}};
  return simulationMeshOf(std::move(mesh), "one");
}

Mat3 anyRotation(std::mt19937& random) {
  std::uniform_real_distribution<double> angle(-2.0, 2.0);
  const double x = angle(random), y = angle(random), z = angle(random);
  return expRotation({x, y, z}).toRotationMatrix();
}

Mat3 anySymmetric(std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  Mat3 m;
  for (double& entry : m.reshaped()) entry = uniform(random);
  return m + m.transpose();
}

VecX deformed(const SimulationMesh& mesh, const Mat3& map) {
  VecX x(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
  for (std::size_t i = 0; i < mesh.mesh.nodes.size(); ++i)
    x.segment<3>(static_cast<Eigen::Index>(3 * i)) = map * mesh.mesh.nodes[i];
  return x;
}

struct Stretches {
  const char* name;
  Vec3 s;
  int flat;  // of them
};

class Flat : public ::testing::TestWithParam<Stretches> {};

TEST_P(Flat, ForcesAreMinusTheEnergysGradient) {
  const SimulationMesh mesh = oneTetrahedron();
  const ElasticMesh fem(mesh, {});
  std::mt19937 random(1);
  for (int n = 0; n < 10; ++n) {
    const Mat3 u = anyRotation(random), v = anyRotation(random);
    const VecX x = deformed(mesh, u * GetParam().s.asDiagonal() * v.transpose());
    const VecX way = deformed(mesh, anySymmetric(random) + anyRotation(random));
    const ElasticState state = fem.stateAt(x);
    VecX f;
    fem.forces(x, state, f);
    constexpr double kStep = 1e-6;
    const auto energyAt = [&](double step) { return fem.energy(x + step * way, fem.stateAt(x + step * way)); };
    const double change = (energyAt(kStep) - energyAt(-kStep)) / (2 * kStep);
    EXPECT_NEAR(change, -f.dot(way), 1e-7 * f.norm() * way.norm());
  }
}

// Motion that stretches F = R S but turns neither R nor F: there K has all of the curvature.
TEST_P(Flat, StiffnessIsTheDifferenceOfForcesWhereNothingTurns) {
  const SimulationMesh mesh = oneTetrahedron();
  ElasticMesh fem(mesh, {});
  SymmetricBlockMatrix a = fem.pattern({0, 1, 2, 3});
  std::mt19937 random(2);
  for (int n = 0; n < 10; ++n) {
    const Mat3 u = anyRotation(random), v = anyRotation(random);
    const VecX x = deformed(mesh, u * GetParam().s.asDiagonal() * v.transpose());
    const VecX way = deformed(mesh, u * anySymmetric(random) * v.transpose());
    const ElasticState state = fem.stateAt(x);
    ASSERT_EQ(state.flat.empty(), GetParam().flat == 0);
    fem.assemble(0.0, 1.0, state, a);
    const VecX expected = a.multiply(way);
    constexpr double kStep = 1e-6;
    VecX before, after;
    fem.forces(x - kStep * way, fem.stateAt(x - kStep * way), before);
    fem.forces(x + kStep * way, fem.stateAt(x + kStep * way), after);
    EXPECT_LT(((before - after) / (2 * kStep) - expected).norm(), 1e-6 * expected.norm());
  }
}

TEST_P(Flat, EnergyAheadKnowsTheSame) {
  const SimulationMesh mesh = oneTetrahedron();
  const ElasticMesh fem(mesh, {});
  std::mt19937 random(3);
  const VecX x = deformed(mesh, anyRotation(random) * GetParam().s.asDiagonal());
  const ElasticState state = fem.stateAt(x);
  ElasticAhead ahead;
  EXPECT_EQ(fem.energyAt(x, fem.stateAt(deformed(mesh, Mat3::Identity())), ahead), fem.energy(x, state));
  ASSERT_EQ(ahead.flat.size(), state.flat.size());
  if (GetParam().flat == 0) return;
  EXPECT_EQ(ahead.flat[0].element, 0);
  EXPECT_LT((ahead.flat[0].factor({1, 2, 3}) - state.flat[0].factor({1, 2, 3})).norm(),
            1e-12 * state.flat[0].factor({1, 2, 3}).norm());
  EXPECT_EQ((state.flat[0].stress.array() < 0).count(), GetParam().flat);
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, Flat,
    ::testing::Values(Stretches{"thick", {1.2, 0.8, 0.31}, 0}, Stretches{"flat", {1.3, 0.9, 0.1}, 1},
                      Stretches{"turned_over", {1.1, 0.8, -0.5}, 1}, Stretches{"a_rod", {1.5, 0.2, 0.1}, 2},
                      Stretches{"a_rod_turned_over", {1.5, 0.28, -0.1}, 2}, Stretches{"a_point", {0.25, 0.2, 0.1}, 3}),
    [](const auto& shape) { return std::string(shape.param.name); });

// The linear law alone would turn it over: with nu = 0.45 its height rests at -0.3 of what it was.
TEST(FlatElement, ABaseDrawnOutLeavesSomeHeight) {
  const SimulationMesh mesh = oneTetrahedron();
  Material material;
  material.poisson_ratio = 0.45;
  const ElasticMesh fem(mesh, material);
  const auto lift = [&](double s) {
    const VecX x = deformed(mesh, Vec3(1.8, 1.8, s).asDiagonal());
    VecX f;
    fem.forces(x, fem.stateAt(x), f);
    return f[11];
  };
  double low = -1, high = 1;
  ASSERT_GT(lift(low), 0);
  ASSERT_LT(lift(high), 0);
  for (int n = 0; n < 60; ++n) {
    const double middle = 0.5 * (low + high);
    (lift(middle) > 0 ? low : high) = middle;
  }
  EXPECT_GT(low, 0.15);
  EXPECT_LT(low, FlatElement::kStretch);
}

TEST(FlatElement, IsFoundByItsIndex) {
  std::vector<FlatElement> flat;
  for (const int index : {2, 5, 9}) flat.emplace_back(index, Mat3::Identity(), 0.1 * Mat3::Identity(), 1.0);
  EXPECT_EQ(flatElement(flat, 5), &flat[1]);
  EXPECT_EQ(flatElement(flat, 9), &flat[2]);
  for (const int index : {0, 3, 10}) EXPECT_EQ(flatElement(flat, index), nullptr);
}

}  // namespace
}  // namespace palpate
