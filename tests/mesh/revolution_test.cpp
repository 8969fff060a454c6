#include "palpate/mesh/revolution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "palpate/common/error.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/mesh/winding_number.h"

namespace palpate {
namespace {

constexpr double kHalfTurn = std::numbers::pi;

/// Area of a regular polygon of n corners over that of its circle.
double polygonShare(int n) { return std::sin(2 * kHalfTurn / n) / (2 * kHalfTurn / n); }

/// Volume of the exact solid by Pappus: 2 pi times the first moment of the polygon about the axis.
double pappusVolume(const RevolutionProfile& p) {
  double moment = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const auto& [r0, z0] = p[i];
    const auto& [r1, z1] = p[(i + 1) % p.size()];
    moment += (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1) / 6;
  }
  return 2 * kHalfTurn * std::abs(moment);
}

void expectSolid(const Surface& surface, int euler, int components = 1) {
  const SurfaceTopology topology = inspectTopology(surface);
  EXPECT_TRUE(topology.closed());
  EXPECT_EQ(topology.euler, euler);
  EXPECT_EQ(topology.components, components);
  std::vector<char> used(surface.vertices.size(), 0);
  for (const auto& t : surface.triangles)
    for (int v : t) used[static_cast<std::size_t>(v)] = 1;
  EXPECT_EQ(std::count(used.begin(), used.end(), 0), 0);
  EXPECT_GT(measureSurface(surface).volume, 0);
}

const RevolutionProfile kCylinder{{0, 0}, {0.02, 0}, {0.02, 0.05}, {0, 0.05}};
// a block with a chamfered blind hole
const RevolutionProfile kSocket{{0, 0},         {0.03, 0},     {0.03, 0.04}, {0.017, 0.04},
                                {0.014, 0.036}, {0.014, 0.01}, {0, 0.01}};
const RevolutionProfile kRing{{0.014, 0}, {0.03, 0}, {0.03, 0.04}, {0.017, 0.04}, {0.014, 0.036}};
const RevolutionProfile kHollow{{0, 0},    {0.02, 0},     {0.02, 0.04},  {0, 0.04},
                                {0, 0.03}, {0.012, 0.03}, {0.012, 0.01}, {0, 0.01}};

const RevolutionProfile kLongAxis{{0, 0}, {0.02, 0}, {0.02, 0.05}, {0, 0.05}, {0, 0.03}, {0, 0.02}};

TEST(Revolution, SolidsAreClosedAndOrientedWhateverTheDirectionOfTheProfile) {
  struct Case {
    RevolutionProfile profile;
    int euler, components;
  };
  for (const Case& c : {Case{kCylinder, 2, 1}, {kSocket, 2, 1}, {kRing, 0, 1}, {kHollow, 4, 2}, {kLongAxis, 2, 1}}) {
    expectSolid(revolutionSurface(c.profile, 48), c.euler, c.components);
    RevolutionProfile reversed = c.profile;
    std::reverse(reversed.begin(), reversed.end());
    expectSolid(revolutionSurface(reversed, 48), c.euler, c.components);
    std::rotate(reversed.begin(), reversed.begin() + 2, reversed.end());
    expectSolid(revolutionSurface(reversed, 8), c.euler, c.components);
    expectSolid(revolutionSurface(c.profile, 9), c.euler, c.components);
  }
}

TEST(Revolution, CylinderIsAPrismOverAPolygon) {
  const Surface surface = revolutionSurface(kCylinder, 48);
  const SurfaceMeasures m = measureSurface(surface);
  EXPECT_NEAR(m.volume / (kHalfTurn * 0.0004 * 0.05), polygonShare(48), 1e-12);
  EXPECT_LT((m.center_of_mass - Vec3(0, 0, 0.025)).norm(), 1e-15);
  const Bounds box = boundsOf(surface.vertices);
  EXPECT_DOUBLE_EQ(box.low.z(), 0);
  EXPECT_DOUBLE_EQ(box.high.z(), 0.05);
  EXPECT_DOUBLE_EQ(box.high.x(), 0.02);
}

// The error of the polygons falls with the square of the segments.
TEST(Revolution, VolumeApproachesPappus) {
  for (const RevolutionProfile& profile : {kSocket, kRing, kHollow}) {
    double last = 0;
    for (int segments : {32, 64, 128}) {
      const double error =
          std::abs(measureSurface(revolutionSurface(profile, segments)).volume / pappusVolume(profile) - 1);
      EXPECT_LT(error, 40.0 / (segments * segments));
      if (last > 0) {
        EXPECT_NEAR(last / error, 4.0, 0.5);
      }
      last = error;
    }
  }
}

TEST(Revolution, TheHoleIsOutside) {
  const WindingNumber solid(revolutionSurface(kSocket, 48));
  EXPECT_FALSE(solid.inside({0, 0, 0.02}));
  EXPECT_FALSE(solid.inside({0.0135, 0, 0.03}));
  EXPECT_TRUE(solid.inside({0.0145, 0, 0.03}));
  EXPECT_FALSE(solid.inside({0.0155, 0, 0.0395}));  // in the chamfer
  EXPECT_TRUE(solid.inside({0, 0, 0.005}));
  const WindingNumber cavity(revolutionSurface(kHollow, 48));
  EXPECT_FALSE(cavity.inside({0, 0, 0.02}));
  EXPECT_TRUE(cavity.inside({0.016, 0, 0.02}));
}

// Divided to the segments' width up to the axis: no long edges, no slivers.
TEST(Revolution, TrianglesAreWellShaped) {
  for (const RevolutionProfile& profile : {kCylinder, kSocket, kRing, kHollow}) {
    for (int segments : {32, 48, 96}) {
      double radius = 0;
      for (const auto& corner : profile) radius = std::max(radius, corner[0]);
      const double width = 2 * kHalfTurn * radius / segments;
      const TriangleQuality quality = measureQuality(revolutionSurface(profile, segments));
      EXPECT_GT(quality.smallest_angle_deg, 15) << segments;
      EXPECT_LT(quality.largest_angle_deg, 130) << segments;
      EXPECT_LT(quality.longest_edge, 1.6 * width) << segments;
      EXPECT_GT(quality.shortest_edge, 0.3 * width) << segments;
    }
  }
}

TEST(Revolution, RejectsProfilesThatBoundNoSolid) {
  const auto cause = [](const RevolutionProfile& p) { return profileObjection(p).value_or("accepted"); };
  EXPECT_EQ(cause(kCylinder), "accepted");
  EXPECT_EQ(cause({{0, 0}, {1, 0}}), "a profile needs at least three corners");
  EXPECT_EQ(cause({{0, 0}, {1, 0}, {-0.1, 1}}), "corner 3 lies at a negative radius");
  EXPECT_EQ(cause({{0, 0}, {1, 0}, {std::nan(""), 1}}), "corner 3 is not finite");
  EXPECT_EQ(cause({{0, 0}, {1, 0}, {1e-6, 1}}), "corner 3 is neither on the axis nor at least 1e-05 m away from it");
  EXPECT_EQ(cause({{0, 0}, {1, 0}, {1, 0}, {0, 1}}), "corner 2 is less than 1e-05 m away from corner 3");
  EXPECT_EQ(cause({{0, 0}, {1, 0}, {0, 1}, {0, 0}}),
            "corner 4 is less than 1e-05 m away from corner 1; the last corner is joined to the first by itself");
  EXPECT_EQ(cause({{0, 0}, {1, -1}, {1, 1}}), "corner 1 touches the axis in a single point");
  EXPECT_EQ(cause({{1, 0}, {2, 1}, {2, 0}, {1, 1}}), "the sides that start at corner 1 and corner 3 cross or touch");
  EXPECT_EQ(cause({{0, 0}, {2, 0}, {2, 2}, {1, 0}, {0, 2}}),
            "the sides that start at corner 1 and corner 3 cross or touch");
  EXPECT_EQ(cause({{0, 0}, {2, 0}, {1, 0}, {0, 1}}), "corner 2 turns back along its side");
  EXPECT_EQ(cause({{0, 0}, {0, 1}, {0, 2}}), "corner 1 turns back along its side");
  EXPECT_EQ(cause(RevolutionProfile(201, {1, 0})), "has 201 corners; at most 200 are allowed");
  EXPECT_THROW(revolutionSurface({{0, 0}, {1, 0}}), InputError);
  EXPECT_THROW(revolutionSurface(kCylinder, 7), InputError);
  EXPECT_THROW(revolutionSurface(kCylinder, 513), InputError);
  EXPECT_THROW(revolutionSurface({{1e-4, 0}, {2e-4, 0}, {2e-4, 10}, {1e-4, 10}}, 512), InputError);
  const double huge = std::numeric_limits<double>::max();
  EXPECT_THROW(revolutionSurface({{1e-4, 0}, {2e-4, 0}, {2e-4, huge}, {1e-4, huge}}, 512), InputError);
}

}  // namespace
}  // namespace palpate
