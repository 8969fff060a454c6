// Tetrahedra around an edge, laid about it once and twice.
#include "palpate/fem/edge_winding.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/fem/elastic_mesh.h"
#include "palpate/mesh/shapes.h"

namespace palpate {
namespace {

// Nodes 0 and 1 on the axis, the others around it, `turns` times in all.
std::vector<Vec3> placesAround(int count, double turns) {
  std::vector<Vec3> places{Vec3(0, 0, -0.01), Vec3(0, 0, 0.01)};
  for (int k = 0; k < count; ++k) {
    const double angle = 2 * std::numbers::pi * turns * k / count;
    places.emplace_back(0.02 * std::cos(angle), 0.02 * std::sin(angle), 0.001 * k);
  }
  return places;
}

TetrahedralMesh meshAround(int count, bool closed) {
  TetrahedralMesh mesh{placesAround(count, 1.0), {}};
  for (int k = 0; k < (closed ? count : count - 1); ++k) mesh.tetrahedra.push_back({0, 1, 2 + k, 2 + (k + 1) % count});
  return mesh;
}

VecX flattened(const std::vector<Vec3>& places) {
  VecX x(static_cast<Eigen::Index>(3 * places.size()));
  for (std::size_t i = 0; i < places.size(); ++i) x.segment<3>(static_cast<Eigen::Index>(3 * i)) = places[i];
  return x;
}

std::vector<int> woundAt(const EdgeWinding& winding, int tetrahedron, const VecX& x) {
  std::vector<int> out;
  winding.around(tetrahedron, x, out);
  std::sort(out.begin(), out.end());
  return out;
}

TEST(EdgeWinding, KnowsWhatLiesTwiceAroundAnEdge) {
  const EdgeWinding winding(meshAround(5, true));
  EXPECT_EQ(winding.innerEdges(), 1);
  const std::vector<int> all{0, 1, 2, 3, 4};
  for (int t = 0; t < 5; ++t) {
    EXPECT_EQ(woundAt(winding, t, flattened(placesAround(5, 2.0))), all);
    EXPECT_TRUE(woundAt(winding, t, flattened(placesAround(5, 1.0))).empty());
    EXPECT_TRUE(woundAt(winding, t, flattened(placesAround(5, -2.0))).empty()) << "all are turned over";
  }
}

TEST(EdgeWinding, AnEdgeOnTheSurfaceIsNone) {
  const EdgeWinding winding(meshAround(5, false));
  EXPECT_EQ(winding.innerEdges(), 0);
  EXPECT_TRUE(woundAt(winding, 0, flattened(placesAround(5, 2.0))).empty());
}

TEST(EdgeWinding, ABarHasThoseInside) {
  EXPECT_EQ(EdgeWinding(barMesh({0.01, 0.01, 0.01}, {1, 1, 1}).mesh).innerEdges(), 1);
  EXPECT_EQ(EdgeWinding(meshAround(7, true)).innerEdges(), 1);
}

// Until they are thick, what has wound is linear: in forces, energy, stiffness, and in what energyAt() finds ahead.
TEST(ElasticMesh, ReleasesWhatIsWoundUntilItIsThick) {
  const SimulationMesh mesh = simulationMeshOf(meshAround(5, true), "ring");
  ElasticMesh fem(mesh, {});
  const VecX rest = flattened(placesAround(5, 1.0));
  VecX wound = flattened(placesAround(5, 2.0)), pressed = rest;
  for (Eigen::Index i = 0; i < rest.size(); i += 3) {
    wound.segment<2>(i) *= 0.7;  // thin beside the axis
    pressed[i + 2] *= 0.1;
  }
  ElasticState state = fem.stateAt(wound);
  const std::vector<int> all{0, 1, 2, 3, 4};
  EXPECT_EQ(state.released, all);
  EXPECT_TRUE(state.flat.empty());
  fem.updateRotations(pressed, state);
  EXPECT_EQ(state.released, all) << "though it is not wound any more";
  const double linear = fem.energy(pressed, state);
  ElasticState fresh = fem.stateAt(pressed);
  EXPECT_EQ(fresh.flat.size(), 5U);
  EXPECT_GT(fem.energy(pressed, fresh), 1.4 * linear);
  fem.updateRotations(rest, state);
  EXPECT_TRUE(state.released.empty());

  ElasticAhead ahead;
  fresh = fem.stateAt(rest);
  const double before = fem.energyAt(wound, fresh, ahead);
  EXPECT_EQ(ahead.released, all);
  EXPECT_TRUE(ahead.flat.empty());
  const ElasticState known = fem.stateAt(wound);
  EXPECT_GT(before, fem.energy(wound, known)) << "the step that wound it up was resisted";
  VecX forces;
  fem.forces(wound, known, forces);
  EXPECT_LT((ahead.forces - forces).norm(), 1e-9 * forces.norm()) << "the next one is not";
}

}  // namespace
}  // namespace palpate
