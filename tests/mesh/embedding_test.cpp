#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/alien.h"
#include "palpate/mesh/bcc_lattice.h"
#include "palpate/mesh/cell_contents.h"
#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/embedding_map.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/tetrahedron_subdivision.h"
#include "shared/hard_surfaces.h"
#include "shared/surface_tools.h"

namespace palpate {
namespace {

using namespace test;

const Alien& alien() {
  static const Alien a = makeAlien();
  return a;
}

TEST(BccLattice, EveryPointLiesInTheTetrahedronThatLocateNames) {
  const BccLattice lattice(Vec3(-1, 2, 0.5), 0.3, {6, 5, 7});
  std::mt19937 random(1);
  std::uniform_real_distribution<double> u(0, 1);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 x = lattice.origin() + 0.3 * Vec3(1 + 4 * u(random), 1 + 3 * u(random), 1 + 5 * u(random));
    const auto at = lattice.locate(x);
    ASSERT_GE(at.tetrahedron, 0);
    EXPECT_GE(at.weights.minCoeff(), -1e-12);
    EXPECT_LT((at.weights - lattice.weights(at.tetrahedron, x)).norm(), 1e-12);
    const auto points = lattice.points(at.tetrahedron);
    Vec3 y = Vec3::Zero();
    std::array<Vec3, 4> p;
    for (size_t k = 0; k < 4; ++k) {
      p[k] = lattice.position(points[k]);
      y += at.weights[static_cast<Eigen::Index>(k)] * p[k];
    }
    EXPECT_LT((x - y).norm(), 1e-12);
    EXPECT_NEAR((p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6, lattice.tetrahedronVolume(), 1e-12);
  }
}

TEST(TetrahedronSubdivision, CutsIntoEqualPartsThatMatchOnEveryFace) {
  for (int m : {1, 2, 3, 5, 8}) {
    const TetrahedronSubdivision cut(m);
    ASSERT_EQ(cut.count(), m * m * m);
    EXPECT_EQ(static_cast<int>(cut.neighbors().size()), (4 * m * m * m - 4 * m * m) / 2);
    std::array<std::set<std::array<int, 3>>, 4> centers;
    for (size_t f = 0; f < 4; ++f) {
      EXPECT_EQ(static_cast<int>(cut.face(f).size()), m * m);
      for (const auto& part : cut.face(f)) {
        std::array<int, 3> on_face{};
        for (size_t k = 0, i = 0; k < 4; ++k)
          if (k != f) on_face[i++] = part.center[k];
        std::array<int, 3> sorted = on_face;
        centers[f].insert(sorted);
      }
    }
    // The pattern of a face is the same whichever face it is and in whichever order its corners come.
    for (const auto& c : centers[0]) {
      for (size_t f = 1; f < 4; ++f) EXPECT_TRUE(centers[f].count(c));
      EXPECT_TRUE(centers[0].count({c[1], c[2], c[0]}) && centers[0].count({c[1], c[0], c[2]}));
    }
    for (int i = 0; i < cut.count(); ++i) EXPECT_EQ(cut.locate(cut.centers()[static_cast<size_t>(i)]), i);
  }
}

SimulationMesh embeddedAlien(int target, EmbedReport& report) {
  EmbedOptions options;
  options.target_tetrahedra = target;
  return embedSurface(alien().surface, options, &report);
}

TEST(EmbedSurface, AlienHasItsCountMassAndCenter) {
  EmbedReport report;
  const SimulationMesh m = embeddedAlien(288, report);
  EXPECT_EQ(complaintsAbout(m), "");
  EXPECT_GE(report.tetrahedra, 250);
  EXPECT_LE(report.tetrahedra, 330);
  EXPECT_EQ(report.components, 1);
  EXPECT_EQ(report.solid_components, 1);
  EXPECT_NEAR(report.mesh_volume / report.surface_volume, 1, 1e-9);
  EXPECT_NEAR(report.sampled_volume / report.surface_volume, 1, 0.01);
  EXPECT_LT(report.center_error, 1e-9);
  EXPECT_GT(report.smallest_weight, -0.35);
  EXPECT_NEAR(report.smallest_dihedral_deg, 60, 1e-6);
}

// Where a surface leaves its tetrahedra, two of them say different things of one place, and it passes through itself.
TEST(EmbedSurface, LittleOfTheSurfaceLeavesItsTetrahedraAndNoNodeIsSoft) {
  for (int target : {150, 288, 1000}) {
    EmbedReport report;
    const SimulationMesh m = embeddedAlien(target, report);
    EXPECT_LT(report.vertices_outside, 0.05 * static_cast<double>(m.surface.vertices.size())) << target;
    EXPECT_GT(report.smallest_weight, -0.2) << target;
    EXPECT_GT(report.softest_node, 0.03) << target;
  }
}

// By what is there where all is thin, by a fifth where the next tetrahedron is full.
TEST(ResistingShares, HoldWhatIsNextToEmptyAndLeaveWhatIsThin) {
  SimulationMesh two;
  two.mesh.nodes = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1), Vec3(1, 1, 1)};
  two.mesh.tetrahedra = {{0, 1, 2, 3}, {1, 2, 3, 4}};
  two.fill = {1, 0.01};
  EXPECT_EQ(resistingShares(two), (std::vector<double>{1, 0.2}));
  two.fill = {0.5, 0.3};
  EXPECT_EQ(resistingShares(two), two.fill);
  two.fill = {0.04, 0.01};
  EXPECT_EQ(resistingShares(two), two.fill);
}

TEST(EmbedSurface, AlienLimbsShareNoTetrahedron) {
  for (int target : {288, 150, 600}) {
    EmbedReport report;
    const SimulationMesh m = embeddedAlien(target, report);
    EXPECT_EQ(fusedTetrahedra(m, 6 * report.cell_size), 0) << target;
  }
}

Mat3 forkRotation() { return expRotation(Vec3(0.2, -0.3, 0.7)).toRotationMatrix(); }

/// Two parallel prongs joined at one end, the gap between them a third of a cell.
Surface fork() {
  const auto f = [](const Vec3& x) {
    const double left = taperedCapsuleDistance(x, Vec3(-0.015, 0, 0), Vec3(-0.015, 0, 0.25), 0.01, 0.01);
    const double right = taperedCapsuleDistance(x, Vec3(0.015, 0, 0), Vec3(0.015, 0, 0.25), 0.01, 0.01);
    const double base = taperedCapsuleDistance(x, Vec3(-0.015, 0, 0), Vec3(0.015, 0, 0), 0.01, 0.01);
    return smoothUnion(std::min(left, right), base, 0.004);
  };
  Surface s = meshImplicit(f, {Vec3(-0.04, -0.025, -0.025), Vec3(0.04, 0.025, 0.275)}, 0.0027, 5);
  // Askew, or the lattice's own planes of symmetry would tell the prongs apart.
  for (Vec3& x : s.vertices) x = forkRotation() * x;
  return s;
}

TEST(EmbedSurface, ParallelProngsAreApartWithVirtualNodesAndFusedWithout) {
  const Surface prongs = fork();
  EmbedOptions options;
  options.cell_size = 0.03;
  EmbedReport report;
  const SimulationMesh apart = embedSurface(prongs, options, &report);
  EXPECT_EQ(complaintsAbout(apart), "");
  EXPECT_GT(report.split_tetrahedra, 0);
  EXPECT_EQ(report.components, 1);
  EXPECT_EQ(fusedTetrahedra(apart, 6 * options.cell_size), 0);

  options.virtual_nodes = false;
  EXPECT_GT(fusedTetrahedra(embedSurface(prongs, options), 6 * options.cell_size), 0);

  // Not just no common tetrahedron: the prongs' ends move independently, so they share no node either.
  const auto nodesNear = [&](const Vec3& place) {
    const Vec3 tip = forkRotation() * place;
    std::set<int> nodes;
    for (size_t v = 0; v < apart.surface.vertices.size(); ++v)
      if ((apart.surface.vertices[v] - tip).norm() < 0.02)
        for (int n : apart.mesh.tetrahedra[static_cast<size_t>(apart.embedding[v].tetrahedron)]) nodes.insert(n);
    return nodes;
  };
  const std::set<int> left = nodesNear(Vec3(-0.015, 0, 0.25)), right = nodesNear(Vec3(0.015, 0, 0.25));
  EXPECT_FALSE(left.empty() || right.empty());
  for (int n : left) EXPECT_FALSE(right.count(n));
}

TEST(EmbedSurface, SeparateBodiesStaySeparateAndCavitiesStayEmpty) {
  Surface two = sphereSurface(0.01, 3);
  const auto add = [&](const Surface& s, const Vec3& shift, bool turned) {
    const int base = static_cast<int>(two.vertices.size());
    for (const Vec3& x : s.vertices) two.vertices.push_back(x + shift);
    for (auto t : s.triangles) {
      if (turned) std::swap(t[0], t[1]);
      two.triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
    }
  };
  add(sphereSurface(0.01, 3), Vec3(0.0205, 0, 0), true);  // inside out: to be turned
  add(sphereSurface(0.005, 3), Vec3::Zero(), true);       // a cavity: to be left alone
  EmbedReport report;
  EmbedOptions options;
  options.target_tetrahedra = 400;
  const SimulationMesh m = embedSurface(two, options, &report);
  EXPECT_EQ(complaintsAbout(m), "");
  EXPECT_EQ(report.solid_components, 2);
  EXPECT_EQ(report.components, 2);
  const double ball = measureSurface(sphereSurface(0.01, 3)).volume;
  EXPECT_NEAR(report.surface_volume, ball * (2 - 0.125), 1e-9 * ball);
  EXPECT_NEAR(report.sampled_volume, report.surface_volume, 0.02 * ball);
}

TEST(EmbedSurface, OverlappingSolidsCountTheirVolumeOnce) {
  const double r = 0.01, d = 0.012;
  Surface two = sphereSurface(r, 5);
  append(two, sphereSurface(r, 5), Vec3(d, 0, 0));
  EmbedReport report;
  EmbedOptions options;
  options.target_tetrahedra = 1000;
  const SimulationMesh m = embedSurface(two, options, &report);
  const double ball = 4.0 / 3 * std::numbers::pi * r * r * r;
  const double lens = std::numbers::pi / 12 * (4 * r + d) * (2 * r - d) * (2 * r - d);
  EXPECT_EQ(complaintsAbout(m), "");
  EXPECT_EQ(report.components, 1);
  EXPECT_NEAR(report.mesh_volume, 2 * ball - lens, 0.01 * ball);
  EXPECT_NEAR(report.overlap_share, lens / (2 * ball - lens), 0.02);
}

TEST(EmbedSurface, SolidsThatTouchAreOne) {
  for (const auto& [size, count] : {std::pair(Vec3(0.05, 0.05, 0.004), 5), std::pair(Vec3(0.02, 0.02, 0.02), 2)}) {
    Surface stack;
    for (int k = 0; k < count; ++k) append(stack, boxSurface(size), Vec3(0, 0, k * size.z()));
    EmbedReport report;
    EmbedOptions options;
    options.target_tetrahedra = 500;
    const SimulationMesh m = embedSurface(stack, options, &report);
    EXPECT_EQ(complaintsAbout(m), "");
    EXPECT_EQ(report.solid_components, 1);
    EXPECT_EQ(report.components, 1);
    EXPECT_EQ(report.overlap_share, 0);
    EXPECT_NEAR(report.mesh_volume, count * size.prod(), 1e-9 * size.prod());
  }
}

TEST(EmbedSurface, NamesWhatIsTooThinAndChoosesACountThatCarriesIt) {
  const Surface plate = boxSurface(Vec3(0.1, 0.1, 0.005));
  EmbedReport report;
  EmbedOptions options;
  embedSurface(plate, options, &report);
  EXPECT_NEAR(report.thickness, 0.005, 0.02 * 0.005);
  EXPECT_GT(report.thin_share, 0.9);
  options.target_tetrahedra = 0;
  embedSurface(plate, options, &report);
  EXPECT_NEAR(report.cell_size, 0.005, 0.1 * 0.005);
  EXPECT_NEAR(report.tetrahedra, report.suggested_tetrahedra, 0.1 * report.suggested_tetrahedra);

  embedSurface(sphereSurface(0.05, 4), options, &report);  // thick all over: the least count will do
  EXPECT_NEAR(report.tetrahedra, 300, 30);
}

TEST(EmbedSurface, CountFollowsTheTargetOnSimpleShapes) {
  for (int target : {60, 300, 1200})
    for (const Surface& s : {sphereSurface(0.05, 4), boxSurface(Vec3(0.1, 0.2, 0.05)), capsuleSurface(0.02, 0.1, 32)}) {
      EmbedOptions options;
      options.target_tetrahedra = target;
      EmbedReport report;
      const SimulationMesh m = embedSurface(s, options, &report);
      EXPECT_EQ(complaintsAbout(m), "");
      EXPECT_NEAR(report.tetrahedra, target, 0.2 * target);
      EXPECT_EQ(report.components, 1);
      EXPECT_LT(report.center_error, 1e-9);
    }
}

TEST(EmbedSurface, SurvivesADamagedAlien) {
  EmbedOptions options;
  options.target_tetrahedra = 288;
  EmbedReport whole, hurt;
  embedSurface(alien().surface, options, &whole);
  options.cell_size = whole.cell_size;
  const SimulationMesh m = embedSurface(damaged(alien().surface, 5), options, &hurt);
  EXPECT_EQ(complaintsAbout(m), "");
  EXPECT_NEAR(hurt.mesh_volume / whole.mesh_volume, 1, 0.01);
  EXPECT_NEAR(hurt.tetrahedra, whole.tetrahedra, 0.03 * whole.tetrahedra);
  EXPECT_EQ(hurt.components, 1);
  EXPECT_GT(hurt.repair.flipped_triangles, 0);
  EXPECT_GT(hurt.repair.topology.holes, 0);
}

TEST(EmbedSurface, IsTheSameEachTime) {
  const SimulationMesh a = embedSurface(alien().surface);
  const SimulationMesh b = embedSurface(alien().surface);
  EXPECT_EQ(a.mesh.tetrahedra, b.mesh.tetrahedra);
  EXPECT_EQ(a.mesh.nodes, b.mesh.nodes);
  EXPECT_EQ(a.fill, b.fill);
}

TEST(CellContents, AreWhatPointsAndTrianglesSay) {
  Surface needle = capsuleSurface(0.004, 0.3, 12);
  const Quat askew = Quat::FromTwoVectors(Vec3::UnitZ(), Vec3(1, 2, 3));
  for (Vec3& x : needle.vertices) x = askew * x;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> u(0, 1);
  for (const Surface& surface : {needle, alien().surface, boxSurface(Vec3(0.2, 0.2, 0.001))}) {
    const InsideField field(surface);
    const Bounds box = boundsOf(surface.vertices);
    const double cell = 0.02 * box.diagonal();
    std::array<int, 3> cells;
    for (size_t d = 0; d < 3; ++d)
      cells[d] = static_cast<int>((box.high - box.low)[static_cast<Eigen::Index>(d)] / cell) + 3;
    const BccLattice lattice(box.low - Vec3::Constant(1.3 * cell), cell, cells);
    const CellContents contents(lattice, field);
    for (const auto& t : surface.triangles)  // what holds a point of the surface is cut
      for (int i = 0; i < 5; ++i) {
        const double a = u(random), b = (1 - a) * u(random);
        const Vec3 x = a * surface.vertices[static_cast<size_t>(t[0])] +
                       b * surface.vertices[static_cast<size_t>(t[1])] +
                       (1 - a - b) * surface.vertices[static_cast<size_t>(t[2])];
        const Vec3 q = (x - lattice.origin()) / cell;
        ASSERT_EQ(contents.at({static_cast<int>(q.x()), static_cast<int>(q.y()), static_cast<int>(q.z())}),
                  CellContents::Content::cut);
      }
    BccLattice::Point c;
    for (c[0] = 0; c[0] < cells[0]; ++c[0])
      for (c[1] = 0; c[1] < cells[1]; ++c[1])
        for (c[2] = 0; c[2] < cells[2]; ++c[2]) {
          const CellContents::Content content = contents.at(c);
          if (content == CellContents::Content::cut) continue;
          const Vec3 x =
              lattice.position({2 * c[0], 2 * c[1], 2 * c[2]}) + cell * Vec3(u(random), u(random), u(random));
          ASSERT_EQ(field.inside(x), content == CellContents::Content::inside);
        }
  }
}

// A lattice over the whole bounding box would have a billion cells.
TEST(EmbedSurface, ANeedleThatLiesAskewIsMeshedAsOneAlongAnAxis) {
  const Surface straight = capsuleSurface(0.001, 1, 12);
  Surface askew = straight;
  const Quat turn = Quat::FromTwoVectors(Vec3::UnitZ(), Vec3(1, 1, 1));
  for (Vec3& x : askew.vertices) x = turn * x;
  EmbedOptions options;
  options.target_tetrahedra = 3000;
  for (const Surface& needle : {straight, askew}) {
    EmbedReport report;
    embedSurface(needle, options, &report);
    EXPECT_NEAR(report.tetrahedra, 3000, 600);
    EXPECT_EQ(report.components, 1);
    EXPECT_LT(report.cell_size, 0.008);  // of 1 m: some 20 tetrahedra hold a cell's length of what lies askew
  }
}

std::string message(const Surface& s, const EmbedOptions& options) {
  try {
    embedSurface(s, options);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(EmbedSurface, SaysWhatWouldDoForASheet) {
  const std::string text = message(boxSurface(Vec3(10, 10, 0.0001)), {});
  EXPECT_NE(text.find("0.0001 m thin"), std::string::npos) << text;
  EXPECT_NE(text.find("200000"), std::string::npos) << text;
}

TEST(EmbedSurface, RefusesBadInputInOneLine) {
  EmbedOptions options;
  options.name = "thing.obj";
  Surface one{{Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)}, {{0, 1, 2}}};
  EXPECT_NE(message(one, options).find("thing.obj: is not a closed surface"), std::string::npos);
  EXPECT_NE(message({}, options).find("no triangles"), std::string::npos);
  Surface bad = sphereSurface(1, 1);
  bad.vertices[3].x() = std::nan("");
  EXPECT_NE(message(bad, options).find("not finite"), std::string::npos);
  for (int target : {-1, -5, 1'000'000}) {
    options.target_tetrahedra = target;
    EXPECT_NE(message(sphereSurface(1, 1), options).find("target_tetrahedra"), std::string::npos);
  }
  options.target_tetrahedra = 300;
  for (double size : {-1.0, std::nan(""), 1e-9, 1e9}) {
    options.cell_size = size;
    EXPECT_NE(message(sphereSurface(1, 1), options).find("cell_size"), std::string::npos) << size;
  }
}

TEST(EmbeddingMap, SpreadIsTheTransposeOfInterpolate) {
  const SimulationMesh m = embedSurface(alien().surface);
  const EmbeddingMap map(m.mesh, m.embedding);
  const std::vector<Vec3> back = map.interpolate(m.mesh.nodes);
  for (size_t v = 0; v < back.size(); ++v) EXPECT_LT((back[v] - m.surface.vertices[v]).norm(), 1e-12);
  std::srand(3);
  const VecX u = VecX::Random(3 * map.meshNodes());
  const VecX f = VecX::Random(3 * map.points());
  EXPECT_NEAR(map.interpolate(u).dot(f), u.dot(map.spread(f)), 1e-9);
  // Total force and total torque survive.
  std::vector<Vec3> forces(static_cast<size_t>(map.points()), Vec3(1, -2, 0.5));
  const std::vector<Vec3> nodal = map.spread(forces);
  Vec3 force = Vec3::Zero(), torque = Vec3::Zero();
  for (size_t n = 0; n < nodal.size(); ++n) {
    force += nodal[n];
    torque += m.mesh.nodes[n].cross(nodal[n]);
  }
  for (size_t v = 0; v < forces.size(); ++v) {
    force -= forces[v];
    torque -= m.surface.vertices[v].cross(forces[v]);
  }
  EXPECT_LT(force.norm() + torque.norm(), 1e-8);
  EXPECT_THROW(map.interpolate(VecX::Zero(3)), std::invalid_argument);
}

TEST(BarMesh, GridsOfTheBenchmarkScene) {
  const std::array<std::array<int, 3>, 3> cells = {{{4, 3, 4}, {8, 6, 9}, {13, 10, 13}}};
  const std::array<size_t, 3> counts = {288, 2592, 10140};
  for (size_t i = 0; i < 3; ++i) {
    const SimulationMesh m = barMesh(Vec3(0.08, 0.06, 0.08), cells[i]);
    EXPECT_EQ(m.mesh.tetrahedra.size(), counts[i]);
    EXPECT_EQ(complaintsAbout(m), "");
    const auto& c = cells[i];
    EXPECT_EQ(m.surface.triangles.size(), static_cast<size_t>(4 * (c[0] * c[1] + c[1] * c[2] + c[2] * c[0])));
    EXPECT_TRUE(inspectTopology(m.surface).closed());
    EXPECT_NEAR(measureSurface(m.surface).volume, 0.08 * 0.06 * 0.08, 1e-12);
    double volume = 0;
    for (const auto& t : m.mesh.tetrahedra) volume += tetrahedronVolume(m.mesh, t);
    EXPECT_NEAR(volume, 0.08 * 0.06 * 0.08, 1e-12);
    for (const EmbeddedPoint& p : m.embedding) EXPECT_EQ(*std::max_element(p.weights.begin(), p.weights.end()), 1.0);
  }
  EXPECT_THROW(barMesh(Vec3(0, 1, 1), {1, 1, 1}), InputError);
  EXPECT_THROW(barMesh(Vec3(1, 1, 1), {0, 1, 1}), InputError);
  EXPECT_THROW(barMesh(Vec3(1, 1, 1), {100000, 100000, 100000}), InputError);
}

}  // namespace
}  // namespace palpate
