#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <numeric>

#include "palpate/fem/elastic_mesh.h"
#include "palpate/mesh/alien.h"
#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/mesh_quality.h"
#include "shared/hard_surfaces.h"
#include "shared/surface_tools.h"

namespace palpate {
namespace {

// Motions that the elastic forces do not resist, to first order: six for a body in one piece without hinges.
int freeMotions(const SimulationMesh& mesh) {
  ElasticMesh elastic(mesh, Material{});
  std::vector<int> row(mesh.mesh.nodes.size());
  std::iota(row.begin(), row.end(), 0);
  SymmetricBlockMatrix a = elastic.pattern(row);
  VecX x(3 * elastic.nodes());
  for (int n = 0; n < elastic.nodes(); ++n) x.segment<3>(3 * n) = mesh.mesh.nodes[n];
  elastic.assemble(0, 1, elastic.stateAt(x), a);
  MatX dense = MatX::Zero(x.size(), x.size());
  for (int j = 0; j < a.size; ++j) {
    for (int s = a.column[j]; s < a.column[j + 1]; ++s) dense.block<3, 3>(3 * a.row[s], 3 * j) = a.block(s);
  }
  const VecX values = Eigen::SelfAdjointEigenSolver<MatX>(dense, Eigen::EigenvaluesOnly).eigenvalues();
  return static_cast<int>((values.array() < 1e-11 * values.maxCoeff()).count());
}

TEST(EmbedSurface, MeshesOfHardSurfacesHaveExactlyTheSixRigidModes) {
  for (const auto& [name, surface] : hardSurfaces()) {
    for (const int target : {120, 300}) {
      EmbedOptions options;
      options.target_tetrahedra = target;
      EmbedReport report;
      const SimulationMesh mesh = embedSurface(surface, options, &report);
      EXPECT_EQ(test::complaintsAbout(mesh), "") << name;
      EXPECT_EQ(freeMotions(mesh), 6) << name << ", " << report.tetrahedra;
      EXPECT_EQ(report.seams, 0) << name << ", " << report.tetrahedra;
    }
  }
}

TEST(EmbedSurface, LargerMeshesHangTogetherThroughFaces) {
  auto surfaces = hardSurfaces();
  surfaces.emplace_back("alien", makeAlien().surface);
  for (const auto& [name, surface] : surfaces) {
    if (name == "needle") continue;  // a lattice over its box has millions of empty cells
    for (const int target : {1500}) {
      EmbedOptions options;
      options.target_tetrahedra = target;
      EmbedReport report;
      const SimulationMesh mesh = embedSurface(surface, options, &report);
      EXPECT_EQ(measureQuality(mesh.mesh).face_components, 1) << name << ", " << report.tetrahedra;
      EXPECT_EQ(report.components, 1) << name;
      EXPECT_EQ(report.seams, 0) << name << ", " << report.tetrahedra;
    }
  }
}

}  // namespace
}  // namespace palpate
