// Corotational elements against their energy, differences, closed forms and a dense textbook assembly.
#include "palpate/fem/elastic_mesh.h"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <numbers>
#include <numeric>
#include <random>

#include "palpate/common/error.h"
#include "palpate/fem/polar.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/shapes.h"

namespace palpate {
namespace {

const Vec3 kSize(0.06, 0.04, 0.05);

SimulationMesh smallBar() { return barMesh(kSize, {2, 2, 2}); }

VecX restPositions(const SimulationMesh& mesh) {
  VecX x(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
  for (std::size_t i = 0; i < mesh.mesh.nodes.size(); ++i)
    x.segment<3>(static_cast<Eigen::Index>(3 * i)) = mesh.mesh.nodes[i];
  return x;
}

VecX randomVector(Eigen::Index size, double scale, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-scale, scale);
  VecX v(size);
  for (Eigen::Index i = 0; i < size; ++i) v[i] = uniform(random);
  return v;
}

VecX mapped(const VecX& x, const Mat3& map, const Vec3& shift) {
  VecX y(x.size());
  for (Eigen::Index i = 0; i < x.size(); i += 3) y.segment<3>(i) = map * x.segment<3>(i) + shift;
  return y;
}

double energyAt(const ElasticMesh& fem, const VecX& x) { return fem.energy(x, fem.stateAt(x)); }

TEST(ElasticMesh, ForcesAreMinusTheEnergysGradientToSecondOrder) {
  const SimulationMesh mesh = smallBar();
  ElasticMesh fem(mesh, {});
  const VecX rest = restPositions(mesh);
  const VecX x = mapped(rest, expRotation({0.4, -1.0, 0.3}).toRotationMatrix(), {0.1, 0, 0}) +
                 randomVector(rest.size(), 0.004, 1);  // strains of about a fifth
  const VecX direction = randomVector(rest.size(), 1.0, 2);
  const ElasticState state = fem.stateAt(x);
  VecX f;
  fem.forces(x, state, f);
  const double exact = -f.dot(direction);
  std::vector<double> errors;
  for (const double step : {1e-3, 5e-4, 2.5e-4, 1.25e-4}) {
    errors.push_back(
        std::abs((energyAt(fem, x + step * direction) - energyAt(fem, x - step * direction)) / (2 * step) - exact));
  }
  for (std::size_t i = 1; i < errors.size(); ++i) EXPECT_NEAR(errors[i - 1] / errors[i], 4.0, 0.2) << i;
  const double finest = (energyAt(fem, x + 1e-6 * direction) - energyAt(fem, x - 1e-6 * direction)) / 2e-6;
  EXPECT_NEAR(finest, exact, 1e-7 * std::abs(exact));
}

// At fixed rotations forces are affine where nothing is flat, so one difference of any length gives K exactly.
TEST(ElasticMesh, StiffnessIsTheDifferenceOfForcesAtFixedRotations) {
  const SimulationMesh mesh = smallBar();
  ElasticMesh fem(mesh, {});
  const VecX x = restPositions(mesh) + randomVector(3 * fem.nodes(), 0.003, 3);
  std::vector<int> rows(fem.nodes());
  std::iota(rows.begin(), rows.end(), 0);
  SymmetricBlockMatrix a = fem.pattern(rows);
  const ElasticState state = fem.stateAt(x);
  fem.assemble(0.0, 1.0, state, a);
  const VecX d = randomVector(x.size(), 0.002, 4);
  VecX f0, f1;
  fem.forces(x, state, f0);
  fem.forces(x + d, state, f1);
  const VecX kd = a.multiply(d);
  EXPECT_LT((f0 - f1 - kd).norm(), 1e-12 * kd.norm());
}

// B^T D B with the 6x6 Hooke matrix and engineering strains, rotated, placed densely: shares nothing with the code.
TEST(ElasticMesh, AssemblyAgreesWithTheDenseTextbook) {
  const SimulationMesh mesh = smallBar();
  Material material;
  material.poisson_ratio = 0.3;
  ElasticMesh fem(mesh, material);
  const VecX x = mapped(restPositions(mesh), expRotation({1.0, 0.5, -0.2}).toRotationMatrix(), {0, 0, 0}) +
                 randomVector(3 * fem.nodes(), 0.003, 5);
  const ElasticState state = fem.stateAt(x);
  const double e = material.youngs_modulus;
  const double nu = material.poisson_ratio;
  Eigen::Matrix<double, 6, 6> hooke = Eigen::Matrix<double, 6, 6>::Zero();
  hooke.topLeftCorner<3, 3>().setConstant(nu);
  hooke.topLeftCorner<3, 3>().diagonal().setConstant(1 - nu);
  hooke.bottomRightCorner<3, 3>().diagonal().setConstant(0.5 - nu);
  hooke *= e / ((1 + nu) * (1 - 2 * nu));
  MatX dense = MatX::Zero(3 * fem.nodes(), 3 * fem.nodes());
  for (std::size_t n = 0; n < mesh.mesh.tetrahedra.size(); ++n) {
    const auto& t = mesh.mesh.tetrahedra[n];
    Eigen::Matrix4d c;
    for (int k = 0; k < 4; ++k) c.row(k) << 1.0, mesh.mesh.nodes[t[k]].transpose();
    const Eigen::Matrix4d inverse = c.inverse();
    const double volume = std::abs(c.determinant()) / 6.0;
    Eigen::Matrix<double, 6, 12> b = Eigen::Matrix<double, 6, 12>::Zero();
    for (int k = 0; k < 4; ++k) {
      const Vec3 g = inverse.block<3, 1>(1, k);
      b.middleCols<3>(3 * k) << g.x(), 0, 0, 0, g.y(), 0, 0, 0, g.z(), g.y(), g.x(), 0, 0, g.z(), g.y(), g.z(), 0,
          g.x();
    }
    const Mat3 r = state.rotations[n];
    Eigen::Matrix<double, 12, 12> turn = Eigen::Matrix<double, 12, 12>::Zero();
    for (int k = 0; k < 4; ++k) turn.block<3, 3>(3 * k, 3 * k) = r;
    const Eigen::Matrix<double, 12, 12> ke = volume * turn * b.transpose() * hooke * b * turn.transpose();
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) dense.block<3, 3>(3 * t[i], 3 * t[j]) += ke.block<3, 3>(3 * i, 3 * j);
    }
  }
  // some nodes without a row, the others in reverse
  std::vector<int> rows(fem.nodes(), -1);
  int count = 0;
  for (int i = fem.nodes() - 1; i >= 0; --i) {
    if (i % 5 != 2) rows[i] = count++;
  }
  SymmetricBlockMatrix a = fem.pattern(rows);
  fem.assemble(1.5, 0.25, state, a);
  const MatX result = a.multiplyColumns(MatX::Identity(3 * count, 3 * count));
  double worst = 0;
  for (int i = 0; i < fem.nodes(); ++i) {
    for (int j = 0; j < fem.nodes(); ++j) {
      if (rows[i] < 0 || rows[j] < 0) continue;
      Mat3 expected = 0.25 * dense.block<3, 3>(3 * i, 3 * j);
      if (i == j) expected.diagonal().array() += 1.5 * fem.mass()[i];
      worst = std::max(worst, (result.block<3, 3>(3 * rows[i], 3 * rows[j]) - expected).cwiseAbs().maxCoeff());
    }
  }
  EXPECT_LT(worst, 1e-12 * dense.cwiseAbs().maxCoeff());
}

TEST(ElasticMesh, RigidMotionGivesNoForceAndNoEnergy) {
  const SimulationMesh mesh = smallBar();
  ElasticMesh fem(mesh, {});
  const VecX rest = restPositions(mesh);
  std::mt19937 random(6);
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  const double scale = fem.material().youngs_modulus * kSize.x() * kSize.y();  // [N]
  for (int n = 0; n < 20; ++n) {
    const Mat3 r = expRotation({angle(random), angle(random), angle(random)}).toRotationMatrix();
    const VecX x = mapped(rest, r, Vec3(angle(random), angle(random), angle(random)));
    const ElasticState state = fem.stateAt(x);
    VecX f;
    fem.forces(x, state, f);
    EXPECT_LT(f.cwiseAbs().maxCoeff(), 1e-11 * scale);
    EXPECT_LT(fem.energy(x, state), 1e-20 * scale + 1e-24);
  }
}

// What energyAt() finds ahead is what would be found anew, to the bit.
TEST(ElasticMesh, ForcesFoundAheadAreThoseFoundAnew) {
  const SimulationMesh mesh = smallBar();
  const ElasticMesh fem(mesh, {});
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  const VecX rest = restPositions(mesh);
  const auto bent = [&] { return VecX(rest + VecX::NullaryExpr(rest.size(), [&] { return 0.002 * normal(random); })); };
  ElasticState state = fem.stateAt(rest);
  ElasticAhead ahead;
  for (int n = 0; n < 3; ++n) {
    const VecX x = bent();
    state.stiffness_scale = n + 1.0;
    const double energy = fem.energyAt(x, state, ahead);
    EXPECT_TRUE(ahead.isFor(x));
    EXPECT_FALSE(ahead.isFor(bent()));
    fem.updateRotations(x, state);
    VecX f;
    fem.forces(x, state, f);
    EXPECT_EQ(f, ahead.forces);
    EXPECT_TRUE(state.rotations == ahead.rotations);
    EXPECT_DOUBLE_EQ(energy, fem.energy(x, state));
    ahead.clear();
    EXPECT_FALSE(ahead.isFor(x));
  }
}

// Under tension in all directions nothing is cut off: the stiffness with tension is the energy's whole second
// derivative.
TEST(ElasticMesh, StiffnessWithTensionIsThatOfCentralDifferences) {
  const SimulationMesh mesh = smallBar();
  ElasticMesh fem(mesh, {});
  std::vector<int> row(mesh.mesh.nodes.size());
  std::iota(row.begin(), row.end(), 0);
  SymmetricBlockMatrix a = fem.pattern(row);
  const Mat3 r = expRotation({0.3, 2.0, -0.4}).toRotationMatrix();
  const Mat3 stretch = Vec3(1.3, 1.2, 1.4).asDiagonal();
  const VecX x = mapped(restPositions(mesh), r * stretch, Vec3::Zero()) + randomVector(3 * fem.nodes(), 2e-4, 3);
  const ElasticState state = fem.stateAt(x);
  std::vector<Mat3> tension;
  fem.tensionFactors(x, state, 1.0, tension);
  fem.assemble(0, 1, state, a, tension);
  for (unsigned seed = 0; seed < 5; ++seed) {
    const VecX dx = randomVector(3 * fem.nodes(), 1e-7, 20 + seed);
    VecX before, after;
    fem.forces(x - dx, fem.stateAt(x - dx), before);
    fem.forces(x + dx, fem.stateAt(x + dx), after);
    const VecX expected = 0.5 * (before - after);
    EXPECT_LT((a.multiply(dx) - expected).norm(), 1e-6 * expected.norm());
  }
}

// Stretched, pressed and sheared: K and what turning adds are the energy's whole second derivative, of either sign.
// Some nodes stay where they are.
TEST(ElasticMesh, TurningStiffnessIsWhatFixedRotationsLeaveOut) {
  const SimulationMesh mesh = smallBar();
  Material material;
  material.poisson_ratio = 0.4;
  ElasticMesh fem(mesh, material);
  std::vector<int> row(mesh.mesh.nodes.size(), -1);
  int free = 0;
  for (std::size_t i = 0; i < row.size(); ++i)
    if (i % 7 != 0) row[i] = free++;
  SymmetricBlockMatrix a = fem.pattern(row);
  const MatX shapes = randomVector(15 * free, 1.0, 4).reshaped(3 * free, 5);
  const Mat3 r = expRotation({0.3, 2.0, -0.4}).toRotationMatrix();
  for (const Vec3& stretch : {Vec3(1.3, 1.2, 1.4), Vec3(0.7, 0.8, 0.9), Vec3(0.4, 1.5, 1.0), Vec3(0.35, 0.4, 1.7)}) {
    const VecX x = mapped(restPositions(mesh), r * Mat3(stretch.asDiagonal()), Vec3::Zero()) +
                   randomVector(3 * fem.nodes(), 2e-4, 3);
    const ElasticState state = fem.stateAt(x);
    ASSERT_TRUE(state.flat.empty());
    fem.assemble(0, 1, state, a);
    const MatX known = shapes.transpose() * a.multiplyColumns(shapes);
    const MatX given = known + fem.turningStiffness(x, state, row, shapes);
    MatX expected(5, 5);
    for (Eigen::Index k = 0; k < 5; ++k) {
      VecX dx = VecX::Zero(x.size()), before, after, slope(3 * free);
      for (std::size_t i = 0; i < row.size(); ++i) {
        const auto at = static_cast<Eigen::Index>(3 * i);
        if (row[i] >= 0) dx.segment<3>(at) = 1e-7 * shapes.col(k).segment<3>(3 * row[i]);
      }
      fem.forces(x - dx, fem.stateAt(x - dx), before);
      fem.forces(x + dx, fem.stateAt(x + dx), after);
      for (std::size_t i = 0; i < row.size(); ++i) {
        const auto at = static_cast<Eigen::Index>(3 * i);
        if (row[i] >= 0) slope.segment<3>(3 * row[i]) = (before - after).segment<3>(at) / 2e-7;
      }
      expected.col(k) = shapes.transpose() * slope;
    }
    EXPECT_LT((given - expected).norm(), 1e-5 * expected.norm());
    EXPECT_GT((known - expected).norm(), 0.02 * expected.norm()) << "what the test is for";
  }
}

// A bar twice as long as at rest under its ends' pull is a string: sideways it is held by the pull, which fixed
// rotations do not know.
TEST(ElasticMesh, TensionHoldsAStringSideways) {
  const SimulationMesh mesh = barMesh(Vec3(0.2, 0.005, 0.005), {16, 1, 1});
  Material material;
  material.poisson_ratio = 0.0;
  ElasticMesh fem(mesh, material);
  VecX x = restPositions(mesh);
  for (int i = 0; i < fem.nodes(); ++i) x[3 * i] *= 1.5;
  const double pull = material.youngs_modulus * 0.5 * 0.005 * 0.005;  // [N]
  std::vector<int> row(mesh.mesh.nodes.size());
  std::iota(row.begin(), row.end(), 0);
  SymmetricBlockMatrix a = fem.pattern(row);
  const ElasticState state = fem.stateAt(x);
  std::vector<Mat3> tension;
  fem.tensionFactors(x, state, 1.0, tension);
  fem.assemble(0, 1, state, a, tension);
  VecX wave = VecX::Zero(3 * fem.nodes());  // half a sine, sections turning along
  const double k = std::numbers::pi / 0.3;
  for (int i = 0; i < fem.nodes(); ++i) {
    const double s = x[3 * i];
    wave[3 * i + 1] = std::sin(k * s);
    wave[3 * i] = -(x[3 * i + 1] - 0.0025) * k * std::cos(k * s);
  }
  // of a string of length l: integral of pull (dy/ds)^2 = pull k^2 l / 2
  const double expected = pull * k * k * 0.3 / 2;
  EXPECT_NEAR(wave.dot(a.multiply(wave)) / expected, 1.0, 0.05);
}

// Forces, energy and K are those of a body of a stiffer material.
TEST(ElasticMesh, StiffnessScaleIsThatOfTheMaterial) {
  const SimulationMesh mesh = smallBar();
  Material stiffer;
  stiffer.youngs_modulus *= 3.0;
  const ElasticMesh soft(mesh, {}), stiff(mesh, stiffer);
  const VecX x = restPositions(mesh) + randomVector(3 * soft.nodes(), 0.003, 9);
  ElasticState scaled = soft.stateAt(x);
  scaled.stiffness_scale = 3.0;
  const ElasticState own = stiff.stateAt(x);
  VecX f, expected;
  soft.forces(x, scaled, f);
  stiff.forces(x, own, expected);
  EXPECT_LT((f - expected).norm(), 1e-14 * expected.norm());
  EXPECT_NEAR(soft.energy(x, scaled), stiff.energy(x, own), 1e-14 * stiff.energy(x, own));
}

// Patch test: x = R S X with S symmetric gives each element the same stress, so interior nodes feel no force and a
// face's nodes sum to stress times area.
TEST(ElasticMesh, PatchTestGivesConstantStress) {
  const SimulationMesh mesh = barMesh(kSize, {3, 3, 3});
  Material material;
  material.poisson_ratio = 0.35;
  ElasticMesh fem(mesh, material);
  Mat3 stretch;
  stretch << 1.15, 0.05, -0.02, 0.05, 0.9, 0.03, -0.02, 0.03, 1.02;
  const Mat3 r = expRotation({0.3, 2.0, -0.4}).toRotationMatrix();
  const VecX x = mapped(restPositions(mesh), r * stretch, {0.2, 0.1, 0});
  const ElasticState state = fem.stateAt(x);
  VecX f;
  fem.forces(x, state, f);
  const double nu = material.poisson_ratio;
  const double lame = material.youngs_modulus * nu / ((1 + nu) * (1 - 2 * nu));
  const double shear = material.youngs_modulus / (2 * (1 + nu));
  const Mat3 strain = stretch - Mat3::Identity();
  const Mat3 stress = r * (lame * strain.trace() * Mat3::Identity() + 2 * shear * strain);
  const double scale = stress.norm() * kSize.x() * kSize.y();
  Vec3 face = Vec3::Zero();  // total over the nodes on x = 0, whose outward normal is -x; edges carry other faces too
  Vec3 interior = Vec3::Zero();
  Vec3 total = Vec3::Zero();
  for (int i = 0; i < fem.nodes(); ++i) {
    const Vec3& p = mesh.mesh.nodes[i];
    const Vec3 at = f.segment<3>(3 * i);
    total += at;
    const bool inside = (p.array() > 1e-9).all() && (p.array() < kSize.array() - 1e-9).all();
    if (inside) interior = interior.cwiseMax(at.cwiseAbs());
    if (p.x() < 1e-9) face += at;
  }
  EXPECT_LT(interior.maxCoeff(), 1e-12 * scale);
  EXPECT_LT(total.norm(), 1e-12 * scale);
  // the faces y = 0 and y = max (and z) give the nodes on x = 0 opposite forces, so they cancel in the sum
  const Vec3 expected = stress * Vec3(kSize.y() * kSize.z(), 0, 0);
  EXPECT_LT((face - expected).norm(), 1e-11 * scale);
}

TEST(ElasticMesh, MassIsDensityTimesVolume) {
  Material material;
  material.density = 870;
  const ElasticMesh bar(smallBar(), material);
  EXPECT_NEAR(bar.mass().sum(), 870 * kSize.prod(), 1e-14);
  // half filled tetrahedra weigh and resist half
  SimulationMesh half = smallBar();
  for (double& f : half.fill) f = 0.5;
  for (auto& s : half.share) {
    for (double& k : s) k *= 0.5;
  }
  const ElasticMesh light(half, material);
  EXPECT_NEAR(light.mass().sum(), 0.5 * 870 * kSize.prod(), 1e-14);
  EXPECT_DOUBLE_EQ(light.elements()[3].mu, 0.5 * bar.elements()[3].mu);
}

// Layers along z: springs in series. Without lateral strain (all nodes move along z only) and with nu = 0 the stress is
// the same in all layers, so each layer's strain is stress / E.
TEST(ElasticMesh, LayeredBarIsSpringsInSeries) {
  const SimulationMesh mesh = barMesh(kSize, {2, 2, 5});
  const std::array<double, 5> young{2e4, 1e5, 5e3, 2e6, 3e4};
  const double thickness = kSize.z() / 5;
  const auto layerOf = [&](double z) { return std::min(4, static_cast<int>(z / thickness)); };
  std::vector<ElementMaterial> materials;
  for (const Vec3& c : elementCentroids(mesh.mesh)) materials.push_back({young[layerOf(c.z())], 0.0, 1000.0});
  ElasticMesh fem(mesh, {}, materials);
  const double stress = -150.0;  // [Pa]
  const auto shift = [&](double z) {
    double sum = 0;
    for (int k = 0; k < 5; ++k) sum += stress / young[k] * std::clamp(z - k * thickness, 0.0, thickness);
    return sum;
  };
  VecX x = restPositions(mesh);
  for (Eigen::Index i = 2; i < x.size(); i += 3) x[i] += shift(x[i]);
  const ElasticState state = fem.stateAt(x);
  VecX f;
  fem.forces(x, state, f);
  const double area = kSize.x() * kSize.y();
  double top = 0, bottom = 0, elsewhere = 0;
  for (int i = 0; i < fem.nodes(); ++i) {
    const double z = mesh.mesh.nodes[i].z();
    if (z > kSize.z() - 1e-9) {
      top += f[3 * i + 2];
    } else if (z < 1e-9) {
      bottom += f[3 * i + 2];
    } else {
      elsewhere = std::max(elsewhere, f.segment<3>(3 * i).norm());
    }
  }
  EXPECT_NEAR(top, -stress * area, 1e-11 * std::abs(stress) * area);
  EXPECT_NEAR(bottom, stress * area, 1e-11 * std::abs(stress) * area);
  EXPECT_LT(elsewhere, 1e-10 * std::abs(stress) * area);
  double compliance = 0;  // energy is half the force times the shortening
  for (const double e : young) compliance += thickness / (e * area);
  EXPECT_NEAR(fem.energy(x, state), 0.5 * std::pow(stress * area, 2) * compliance, 1e-10 * fem.energy(x, state));
}

TEST(ElasticMesh, MassIsTheSumOfTheParts) {
  const SimulationMesh mesh = barMesh(kSize, {2, 2, 5});
  std::vector<ElementMaterial> materials;
  for (const Vec3& c : elementCentroids(mesh.mesh))
    materials.push_back({2e4, 0.3, c.z() < 0.4 * kSize.z() ? 400. : 1500.});
  const ElasticMesh fem(mesh, {}, materials);
  EXPECT_NEAR(fem.mass().sum(), (0.4 * 400 + 0.6 * 1500) * kSize.prod(), 1e-14);
  double moment = 0;
  for (int i = 0; i < fem.nodes(); ++i) moment += fem.mass()[i] * mesh.mesh.nodes[i].z();
  const double expected = (400 * 0.5 * 0.16 + 1500 * 0.5 * (1 - 0.16)) * kSize.prod() * kSize.z();
  EXPECT_NEAR(moment, expected, 1e-14);
}

TEST(ElasticMesh, EqualPartsAreTheUniformBody) {
  const SimulationMesh mesh = smallBar();
  Material material;
  material.poisson_ratio = 0.3;
  material.density = 700;
  const std::vector<ElementMaterial> equal(mesh.mesh.tetrahedra.size(), {material.youngs_modulus, 0.3, 700});
  const ElasticMesh uniform(mesh, material), parts(mesh, material, equal);
  EXPECT_EQ(uniform.mass(), parts.mass());
  for (std::size_t i = 0; i < equal.size(); ++i) {
    EXPECT_EQ(uniform.elements()[i].lambda, parts.elements()[i].lambda);
    EXPECT_EQ(uniform.elements()[i].mu, parts.elements()[i].mu);
  }
}

TEST(ElasticMesh, RefusesImpossibleParts) {
  const SimulationMesh mesh = smallBar();
  std::vector<ElementMaterial> materials(mesh.mesh.tetrahedra.size());
  EXPECT_NO_THROW(ElasticMesh(mesh, {}, materials));
  materials.emplace_back();
  EXPECT_THROW(ElasticMesh(mesh, {}, materials), InputError);  // one too many
  materials.pop_back();
  materials.back().youngs_modulus = 0;
  EXPECT_THROW(ElasticMesh(mesh, {}, materials), InputError);
}

TEST(ElasticMesh, RefusesImpossibleMaterialsAndElements) {
  const SimulationMesh mesh = smallBar();
  const auto with = [](auto change) {
    Material m;
    change(m);
    return m;
  };
  EXPECT_THROW(ElasticMesh(mesh, with([](Material& m) { m.youngs_modulus = 0; })), InputError);
  EXPECT_THROW(ElasticMesh(mesh, with([](Material& m) { m.density = -1; })), InputError);
  EXPECT_THROW(ElasticMesh(mesh, with([](Material& m) { m.poisson_ratio = 0.5; })), InputError);
  EXPECT_THROW(ElasticMesh(mesh, with([](Material& m) { m.damping_beta = -1; })), InputError);
  EXPECT_THROW(ElasticMesh(mesh, with([](Material& m) { m.damping_alpha = NAN; })), InputError);
  EXPECT_THROW(ElasticMesh(mesh, with([](Material& m) { m.damping_beta = INFINITY; })), InputError);
  SimulationMesh flat = mesh;
  flat.mesh.nodes[flat.mesh.tetrahedra[0][1]] = flat.mesh.nodes[flat.mesh.tetrahedra[0][0]];
  EXPECT_THROW(ElasticMesh(flat, Material{}), InputError);
}

}  // namespace
}  // namespace palpate
