#include <gtest/gtest.h>

#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/simplify_surface.h"
#include "palpate/mesh/surface_io.h"
#include "shared/bunny.h"
#include "shared/surface_tools.h"

namespace palpate {
namespace {

using namespace test;

const Surface& bunny() {
  // readSurface says which file is missing: it comes from the package glmark2-data.
  static const Surface s = readSurface(kBunnyFile);
  return s;
}

TEST(Bunny, IsTheScanThatTheScenesExpect) {
  EXPECT_EQ(bunny().triangles.size(), 69666u);
  EXPECT_TRUE(inspectTopology(repairSurface(bunny()).surface).closed());
}

TEST(Bunny, EmbedsAtBothSizes) {
  for (int target : {300, 3000}) {
    EmbedOptions options;
    options.target_tetrahedra = target;
    EmbedReport report;
    const SimulationMesh m = embedSurface(bunny(), options, &report);
    EXPECT_EQ(complaintsAbout(m), "");
    EXPECT_NEAR(report.tetrahedra, target, 0.1 * target);
    EXPECT_EQ(report.components, 1);
    EXPECT_NEAR(report.sampled_volume / report.surface_volume, 1, 0.005);
    EXPECT_NEAR(report.mesh_volume / report.surface_volume, 1, 1e-9);
    EXPECT_EQ(fusedTetrahedra(m, 8 * report.cell_size), 0);
  }
}

TEST(Bunny, IsSimplifiedForItsMesh) {
  for (const int target : {300, 3000}) {
    EmbedOptions options;
    options.target_tetrahedra = target;
    options.surface_tolerance.reset();
    EmbedReport report;
    const SimulationMesh m = embedSurface(bunny(), options, &report);
    EXPECT_EQ(complaintsAbout(m), "");
    EXPECT_EQ(report.given_triangles, 69666);
    EXPECT_LT(m.surface.triangles.size(), 69666u / 3);
    EXPECT_LE(report.surface_deviation, kSurfaceTolerance * report.cell_size);
    EXPECT_TRUE(inspectTopology(m.surface).closed());
    EXPECT_EQ(inspectTopology(m.surface).euler, 2);
  }
  // a thousand holes as well
  const Surface hurt = repairSurface(damaged(bunny(), 9)).surface;
  const double size = (boundsOf(hurt.vertices).high - boundsOf(hurt.vertices).low).norm();
  const SimplifiedSurface simpler = simplifySurface(hurt, 0.002 * size);
  EXPECT_LT(simpler.surface.triangles.size(), hurt.triangles.size() / 2);
  EXPECT_EQ(inspectTopology(simpler.surface).components, inspectTopology(hurt).components);
}

TEST(Bunny, SurvivesDamage) {
  EmbedOptions options;
  EmbedReport whole, hurt;
  embedSurface(bunny(), options, &whole);
  options.cell_size = whole.cell_size;
  const SimulationMesh m = embedSurface(damaged(bunny(), 9), options, &hurt);
  EXPECT_EQ(complaintsAbout(m), "");
  EXPECT_NEAR(hurt.mesh_volume / whole.mesh_volume, 1, 0.01);
  EXPECT_NEAR(hurt.tetrahedra, whole.tetrahedra, 0.03 * whole.tetrahedra);
  EXPECT_EQ(hurt.components, 1);
  EXPECT_GT(hurt.repair.topology.holes, 100);
}

}  // namespace
}  // namespace palpate
