#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "palpate/common/error.h"
#include "palpate/mesh/alien.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/refine_surface.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/surface_repair.h"
#include "palpate/mesh/winding_number.h"
#include "shared/surface_tools.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kPi = std::numbers::pi;

TEST(SurfaceMeasures, BoxAwayFromTheOrigin) {
  Surface box = boxSurface(Vec3(0.1, 0.2, 0.3), {2, 3, 1});
  for (Vec3& x : box.vertices) x += Vec3(5, -4, 3);
  const SurfaceMeasures m = measureSurface(box);
  EXPECT_NEAR(m.volume, 0.006, 1e-14);
  EXPECT_NEAR(m.area, 2 * (0.02 + 0.06 + 0.03), 1e-12);
  EXPECT_LT((m.center_of_mass - Vec3(5, -4, 3)).norm(), 1e-12);
  const Vec3 inertia = 0.006 / 12 * Vec3(0.04 + 0.09, 0.01 + 0.09, 0.01 + 0.04);
  EXPECT_LT((m.inertia - Mat3(inertia.asDiagonal())).norm(), 1e-14);
}

TEST(SurfaceMeasures, SphereAndCapsuleApproachTheirFormulas) {
  for (int levels : {4, 5, 6}) {
    const double v = measureSurface(sphereSurface(2, levels)).volume;
    EXPECT_NEAR(v / (4 * kPi / 3 * 8), 1, 12.0 / std::pow(4, levels));
    EXPECT_LT(v, 4 * kPi / 3 * 8);
  }
  const Surface capsule = capsuleSurface(0.5, 2, 128);
  EXPECT_TRUE(inspectTopology(capsule).closed());
  EXPECT_NEAR(measureSurface(capsule).volume / (kPi * 0.25 * 2 + 4 * kPi / 3 * 0.125), 1, 2e-3);
}

TEST(MassProperties, BoxIsExactWhereverItIsAndHoweverItIsTurned) {
  Surface box = boxSurface(Vec3(0.1, 0.2, 0.3), {2, 3, 1});
  const Quat turn(Eigen::AngleAxisd(0.7, Vec3(1, -2, 0.5).normalized()));
  for (Vec3& x : box.vertices) x = turn * x + Vec3(5, -4, 3);
  const MassProperties m = surfaceMassProperties(box, 700);
  EXPECT_NEAR(m.mass, 4.2, 1e-11);
  EXPECT_LT((m.center_of_mass - Vec3(5, -4, 3)).norm(), 1e-12);
  const Vec3 moments = 4.2 / 12 * Vec3(0.04 + 0.09, 0.01 + 0.09, 0.01 + 0.04);
  const Mat3 expected = turn.toRotationMatrix() * moments.asDiagonal() * turn.toRotationMatrix().transpose();
  EXPECT_LT((m.inertia - expected).norm(), 1e-11);
}

// A surface inside the round solid falls short of it by the square of its edges.
TEST(MassProperties, SphereAndCapsuleApproachTheirFormulas) {
  const double density = 500, r = 0.5, length = 2;
  const double ball = density * 4 * kPi / 3 * std::pow(r, 3);
  const double rod = density * kPi * r * r * length;
  const double around = ball * 0.4 * r * r + rod * 0.5 * r * r;
  // two half balls, whose centers of mass lie 3/8 r beyond the ends of the straight part
  const double half = 0.5 * ball * (0.4 - 9.0 / 64.0) * r * r + 0.5 * ball * std::pow(0.5 * length + 3.0 / 8.0 * r, 2);
  const double across = 2 * half + rod * (r * r / 4 + length * length / 12);
  for (int segments : {64, 128, 256}) {
    const MassProperties m = surfaceMassProperties(capsuleSurface(r, length, segments), density);
    const double tolerance = 40.0 / (segments * segments);
    EXPECT_NEAR(m.mass / (ball + rod), 1, tolerance);
    EXPECT_NEAR(m.inertia(2, 2) / around, 1, tolerance);
    EXPECT_NEAR(m.inertia(0, 0) / across, 1, tolerance);
    EXPECT_NEAR(m.inertia(1, 1) / across, 1, tolerance);
    EXPECT_LT(m.center_of_mass.norm(), 1e-13);
  }
  for (int levels : {4, 5, 6}) {
    const MassProperties m = surfaceMassProperties(sphereSurface(r, levels), density);
    EXPECT_LT((m.inertia / (0.4 * ball * r * r) - Mat3::Identity()).norm(), 60.0 / std::pow(4, levels));
  }
}

TEST(MassProperties, ACavityIsLeftOut) {
  Surface shell = boxSurface(Vec3::Constant(0.2));
  Surface inner = boxSurface(Vec3::Constant(0.1));
  for (auto& t : inner.triangles) {
    std::swap(t[0], t[1]);
    for (int& v : t) v += static_cast<int>(shell.vertices.size());
  }
  shell.vertices.insert(shell.vertices.end(), inner.vertices.begin(), inner.vertices.end());
  shell.triangles.insert(shell.triangles.end(), inner.triangles.begin(), inner.triangles.end());
  const MassProperties m = surfaceMassProperties(shell, 1000);
  EXPECT_NEAR(m.mass, 7, 1e-12);
  EXPECT_NEAR(m.inertia(0, 0), 8 * 0.04 / 6 - 1 * 0.01 / 6, 1e-13);
}

TEST(MassProperties, AHoleIsClosed) {
  Surface box = boxSurface(Vec3(0.1, 0.2, 0.3));
  const MassProperties whole = surfaceMassProperties(box, 1000);
  for (Vec3& x : box.vertices) x += Vec3(0.3, 0.2, 0.1);
  box.triangles.resize(box.triangles.size() - 2);
  ASSERT_EQ(inspectTopology(box).boundary_edges, 4);
  const MassProperties open = surfaceMassProperties(box, 1000);
  EXPECT_NEAR(open.mass, whole.mass, 1e-12);
  EXPECT_LT((open.center_of_mass - whole.center_of_mass - Vec3(0.3, 0.2, 0.1)).norm(), 1e-12);
  EXPECT_LT((open.inertia - whole.inertia).norm(), 1e-12);
}

TEST(MassProperties, WhatLiesInSeveralSolidsCountsOnce) {
  const auto both = [](Surface a, const Surface& b, const Vec3& shift) {
    for (auto t : b.triangles) {
      for (int& v : t) v += static_cast<int>(a.vertices.size());
      a.triangles.push_back(t);
    }
    for (const Vec3& x : b.vertices) a.vertices.push_back(x + shift);
    return a;
  };
  const Surface box = boxSurface(Vec3::Constant(0.2));
  const MassProperties crossing = surfaceMassProperties(both(box, box, Vec3(0.1, 0, 0)), 1000);
  EXPECT_NEAR(crossing.mass, 12, 1e-4);
  EXPECT_LT((crossing.center_of_mass - Vec3(0.05, 0, 0)).norm(), 1e-6);
  EXPECT_NEAR(crossing.inertia(0, 0), 12 * 0.08 / 12, 1e-6);
  EXPECT_NEAR(crossing.inertia(2, 2), 12 * (0.09 + 0.04) / 12, 1e-6);
  EXPECT_LT(std::abs(crossing.inertia(0, 1)), 1e-6);
  const MassProperties nested = surfaceMassProperties(both(box, sphereSurface(0.05, 4), Vec3(0.03, 0, 0)), 1000);
  EXPECT_NEAR(nested.mass, 8, 1e-4);
  EXPECT_LT(nested.center_of_mass.norm(), 1e-6);
  const MassProperties touching = surfaceMassProperties(both(box, box, Vec3(0.2, 0, 0)), 1000);
  EXPECT_NEAR(touching.mass, 16, 1e-12);
}

TEST(MassProperties, RejectsWhatHasNoMass) {
  Surface inside_out = boxSurface(Vec3::Constant(0.2));
  for (auto& t : inside_out.triangles) std::swap(t[0], t[1]);
  EXPECT_THROW(surfaceMassProperties(inside_out, 1000), InputError);
  EXPECT_THROW(surfaceMassProperties({}, 1000), InputError);
  EXPECT_THROW(surfaceMassProperties(boxSurface(Vec3::Ones()), 0), InputError);
  EXPECT_THROW(surfaceMassProperties(boxSurface(Vec3::Ones()), NAN), InputError);
}

TEST(SurfaceMeasures, CapsCloseHoles) {
  Surface sphere = sphereSurface(1, 4);
  const double whole = measureSurface(sphere).volume;
  sphere.triangles.erase(sphere.triangles.begin() + 100, sphere.triangles.begin() + 110);
  const Surface capped = capHoles(sphere);
  EXPECT_NEAR(measureSurface(capped).volume, whole, 2e-3 * whole);
  EXPECT_EQ(inspectTopology(capped).boundary_edges, 0);
  EXPECT_GT(inspectTopology(sphere).boundary_edges, 0);
}

TEST(Topology, CountsWhatIsWrong) {
  Surface s = sphereSurface(1, 2);
  EXPECT_TRUE(inspectTopology(s).closed());
  EXPECT_EQ(inspectTopology(s).euler, 2);
  std::swap(s.triangles[7][0], s.triangles[7][1]);
  EXPECT_EQ(inspectTopology(s).inconsistent_edges, 3);
  s.triangles.erase(s.triangles.begin() + 7);
  EXPECT_EQ(inspectTopology(s).boundary_edges, 3);
  EXPECT_EQ(inspectTopology(s).holes, 1);
  s.triangles.push_back(s.triangles[0]);
  EXPECT_EQ(inspectTopology(s).nonmanifold_edges, 3);
}

TEST(Repair, UndoesDamageExactly) {
  const Surface sphere = sphereSurface(1, 3);
  std::mt19937 random(2);
  Surface bad;
  std::bernoulli_distribution flip(0.3);
  for (auto t : sphere.triangles) {
    if (flip(random)) std::swap(t[1], t[2]);
    const int base = static_cast<int>(bad.vertices.size());
    for (int v : t) bad.vertices.push_back(sphere.vertices[static_cast<size_t>(v)] + Vec3::Constant(1e-9));
    bad.triangles.push_back({base, base + 1, base + 2});
  }
  bad.triangles.push_back(bad.triangles[4]);
  bad.triangles.push_back({0, 0, 1});
  bad.vertices.push_back(Vec3(0.5, 0, 0));
  const RepairedSurface fixed = repairSurface(bad);
  EXPECT_EQ(fixed.surface.vertices.size(), sphere.vertices.size());
  EXPECT_EQ(fixed.surface.triangles.size(), sphere.triangles.size());
  EXPECT_TRUE(fixed.report.topology.closed());
  EXPECT_EQ(fixed.report.duplicate_triangles, 1);
  EXPECT_EQ(fixed.report.degenerate_triangles, 1);
  EXPECT_EQ(fixed.report.unused_vertices, 1);
  EXPECT_NEAR(measureSurface(fixed.surface).volume, measureSurface(sphere).volume, 1e-9);
  ASSERT_EQ(fixed.vertex_map.size(), bad.vertices.size());
  EXPECT_EQ(fixed.vertex_map.back(), -1);
}

TEST(Repair, TurnsASurfaceThatIsInsideOut) {
  Surface s = boxSurface(Vec3(1, 1, 1));
  for (auto& t : s.triangles) std::swap(t[0], t[1]);
  const RepairedSurface fixed = repairSurface(s);
  EXPECT_NEAR(measureSurface(fixed.surface).volume, 1, 1e-12);
  EXPECT_EQ(fixed.report.flipped_triangles, 12);
}

/// Boxes side by side, each closed, on a grid of so many.
Surface stacked(const Vec3& size, const std::array<int, 3>& count) {
  Surface all;
  for (int i = 0; i < count[0]; ++i)
    for (int j = 0; j < count[1]; ++j)
      for (int k = 0; k < count[2]; ++k) {
        // The triangles of opposite faces match.
        const int first = static_cast<int>(all.vertices.size());
        for (int v = 0; v < 8; ++v)
          all.vertices.push_back(size.cwiseProduct(Vec3(i + v % 2, j + v / 2 % 2, k + v / 4)));
        for (const auto& t : std::vector<std::array<int, 3>>{{0, 2, 3},
                                                             {0, 3, 1},
                                                             {4, 7, 6},
                                                             {4, 5, 7},
                                                             {0, 5, 4},
                                                             {0, 1, 5},
                                                             {2, 6, 7},
                                                             {2, 7, 3},
                                                             {0, 4, 6},
                                                             {0, 6, 2},
                                                             {1, 7, 5},
                                                             {1, 3, 7}})
          all.triangles.push_back({first + t[0], first + t[1], first + t[2]});
      }
  return all;
}

TEST(Repair, SolidsThatTouchAreOne) {
  const Vec3 size(0.05, 0.04, 0.004);
  for (const std::array<int, 3>& count : {std::array{1, 1, 1}, std::array{2, 1, 1}, std::array{1, 1, 5},
                                          std::array{1, 2, 2}, std::array{2, 2, 2}, std::array{3, 3, 3}}) {
    const RepairedSurface fixed = repairSurface(stacked(size, count));
    const Vec3 whole = size.cwiseProduct(Vec3(count[0], count[1], count[2]));
    const SurfaceMeasures m = measureSurface(fixed.surface);
    EXPECT_TRUE(fixed.report.topology.closed());
    EXPECT_EQ(fixed.report.topology.euler, 2);
    EXPECT_EQ(fixed.report.flipped_triangles, 0);
    EXPECT_NEAR(m.volume / whole.prod(), 1, 1e-12);
    EXPECT_NEAR(m.area / (2 * (whole.x() * whole.y() + whole.y() * whole.z() + whole.z() * whole.x())), 1, 1e-12);
    EXPECT_NO_THROW(requireSolid(fixed.surface, "boxes"));
  }
}

TEST(Repair, OfTrianglesThatComeBothWaysRoundOneStaysWhereTheSurfaceNeedsIt) {
  const Surface box = stacked(Vec3::Ones(), {1, 1, 1});
  const auto turned = [](std::array<int, 3> t) {
    std::swap(t[1], t[2]);
    return t;
  };
  // One face, all of them, and a leaf that stands on an edge.
  for (const size_t count : {size_t{1}, size_t{4}, box.triangles.size()}) {
    Surface both = box;
    for (size_t t = 0; t < count; ++t) both.triangles.push_back(turned(box.triangles[t]));
    const RepairedSurface fixed = repairSurface(both);
    EXPECT_EQ(fixed.report.duplicate_triangles, static_cast<int>(count));
    EXPECT_EQ(fixed.surface.triangles, box.triangles);
  }
  Surface leafy = box;
  leafy.vertices.push_back(Vec3(0.5, 0, -1));
  leafy.triangles.push_back({0, 1, 8});
  leafy.triangles.push_back({0, 8, 1});
  EXPECT_EQ(repairSurface(leafy).report.duplicate_triangles, 1);
  // A face between boxes, of which one is there twice.
  Surface thrice = stacked(Vec3::Ones(), {2, 1, 1});
  for (size_t t = 0; t < 12; ++t) thrice.triangles.push_back(thrice.triangles[t]);
  const RepairedSurface fixed = repairSurface(thrice);
  EXPECT_TRUE(fixed.report.topology.closed());
  EXPECT_NEAR(measureSurface(fixed.surface).volume, 2, 1e-12);
}

TEST(Repair, RequireSolidRefusesSheets) {
  Surface sheet{{Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(1, 1, 0)}, {{0, 1, 2}, {1, 3, 2}}};
  EXPECT_THROW(requireSolid(sheet, "sheet"), InputError);
  EXPECT_THROW(requireSolid({}, "nothing"), InputError);
  Surface half = sphereSurface(1, 3);
  std::erase_if(half.triangles, [&](const auto& t) { return half.vertices[static_cast<size_t>(t[0])].z() < 0.01; });
  EXPECT_THROW(requireSolid(half, "half"), InputError);
  EXPECT_NO_THROW(requireSolid(sphereSurface(1, 3), "ball"));
}

TEST(WindingNumber, AgreesWithItsSlowTwin) {
  const Surface s = damaged(makeAlien().surface, 3);
  const WindingNumber fast(s);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> u(-0.12, 0.12);
  double worst = 0;
  for (int i = 0; i < 300; ++i) {
    const Vec3 x(u(random), u(random), 0.1 + u(random));
    worst = std::max(worst, std::abs(fast.at(x) - fast.exactAt(x)));
  }
  EXPECT_LT(worst, 0.06);
  EXPECT_GT(worst, 0);
}

TEST(WindingNumber, TellsInsideFromOutsideExactly) {
  const WindingNumber sphere(sphereSurface(1, 4));
  std::mt19937 random(5);
  std::normal_distribution<double> n;
  for (int i = 0; i < 500; ++i) {
    const Vec3 d = Vec3(n(random), n(random), n(random)).normalized();
    EXPECT_NEAR(sphere.at(0.98 * d), 1, 0.1);
    EXPECT_NEAR(sphere.at(1.01 * d), 0, 0.1);
  }
  EXPECT_EQ(WindingNumber({}).at(Vec3::Zero()), 0);
}

TEST(Alien, IsAClosedManifoldOfOnePieceWithoutHandles) {
  for (double resolution : {0.0235, 0.018, 0.03}) {
    AlienOptions options;
    options.resolution = resolution;
    const Alien alien = makeAlien(options);
    const SurfaceTopology topology = inspectTopology(alien.surface);
    EXPECT_TRUE(topology.closed());
    EXPECT_EQ(topology.components, 1);
    EXPECT_EQ(topology.euler, 2);
    if (resolution != 0.0235) continue;
    EXPECT_GE(alien.surface.triangles.size(), 4000u);
    EXPECT_LE(alien.surface.triangles.size(), 8000u);
    const TriangleQuality quality = measureQuality(alien.surface);
    EXPECT_GT(quality.smallest_angle_deg, 12);
    EXPECT_LT(quality.largest_angle_deg, 145);
  }
}

TEST(Alien, StandsOnTheGroundAndHasItsLandmarksInside) {
  const Alien alien = makeAlien();
  const Bounds box = boundsOf(alien.surface.vertices);
  EXPECT_NEAR(box.low.z(), 0, 1e-12);
  EXPECT_NEAR(box.high.z(), 0.2, 1e-12);
  EXPECT_NEAR(box.low.x(), -box.high.x(), 2e-3);
  const WindingNumber winding(alien.surface);
  const AlienLandmarks& m = alien.landmarks;
  for (const Vec3& x : {m.head, m.trunk, m.left_hand, m.right_hand, m.left_foot, m.right_foot})
    EXPECT_TRUE(winding.inside(x)) << x.transpose();
  EXPECT_GT(m.left_foot.y(), 0);
  EXPECT_LT(m.left_hand.x(), 0);
  // Volume of the mesh against the volume of the implicit function by a plain grid.
  double cells = 0;
  const double h = 0.01;
  for (double x = -0.495; x < 0.5; x += h)
    for (double y = -0.295; y < 0.3; y += h)
      for (double z = -0.045; z < 1.1; z += h) cells += alienDistance(Vec3(x, y, z)) < 0;
  const double scale = 0.2;
  EXPECT_NEAR(measureSurface(alien.surface).volume / (cells * std::pow(h * scale, 3)), 1, 0.03);
  EXPECT_THROW(makeAlien({-1, 0.02}), InputError);
  EXPECT_THROW(makeAlien({0.2, 1e-9}), InputError);
}

TEST(RefineSurface, KeepsTheShapeClosedAndLeavesNoLongEdge) {
  Surface shapes[] = {boxSurface(Vec3(0.1, 0.03, 0.002)), sphereSurface(0.05, 2), capsuleSurface(0.01, 0.2, 12)};
  for (const Surface& coarse : shapes) {
    for (const double longest : {0.02, 0.007}) {
      const Surface fine = refineSurface(coarse, longest);
      EXPECT_TRUE(inspectTopology(fine).closed());
      EXPECT_LE(measureQuality(fine).longest_edge, longest * (1 + 1e-12));
      const SurfaceMeasures a = measureSurface(coarse), b = measureSurface(fine);
      EXPECT_NEAR(b.volume, a.volume, 1e-12 * a.volume);
      EXPECT_NEAR(b.area, a.area, 1e-12 * a.area);
      for (std::size_t v = 0; v < coarse.vertices.size(); ++v) EXPECT_EQ(fine.vertices[v], coarse.vertices[v]);
    }
  }
  const Surface bounded = refineSurface(boxSurface(Vec3(1, 1, 1)), 1e-5, 50'000);
  EXPECT_LT(bounded.triangles.size(), 100'000u);
  EXPECT_GT(bounded.triangles.size(), 10'000u);
}

TEST(MeshImplicit, SphereVolumeConvergesAndEmptyIsAnError) {
  const auto ball = [](const Vec3& x) { return x.norm() - 1; };
  const Bounds box{Vec3::Constant(-1.3), Vec3::Constant(1.3)};
  double last = 1;
  for (double cell : {0.2, 0.1, 0.05}) {
    const double error = std::abs(measureSurface(meshImplicit(ball, box, cell)).volume / (4 * kPi / 3) - 1);
    EXPECT_LT(error, 0.4 * last);
    last = error;
  }
  EXPECT_THROW(meshImplicit([](const Vec3&) { return 1.0; }, box, 0.2), RunError);
}

}  // namespace
}  // namespace palpate
