#include "palpate/scene/region.h"

#include "palpate/mesh/alien.h"
#include "scene_text.h"

namespace palpate {
namespace {

TEST(Region, HoldsItsInsideAndItsBoundary) {
  EXPECT_TRUE(contains(SphereRegionConfig{{1, 0, 0}, 0.5}, {1.5, 0, 0}));
  EXPECT_FALSE(contains(SphereRegionConfig{{1, 0, 0}, 0.5}, {1.3, 0.41, 0}));
  EXPECT_TRUE(contains(BoxRegionConfig{{0, 0, 0}, {1, 2, 3}}, {1, 2, 0}));
  EXPECT_FALSE(contains(BoxRegionConfig{{0, 0, 0}, {1, 2, 3}}, {1.01, 2, 0}));
  EXPECT_TRUE(contains(CapsuleRegionConfig{{0, 0, 0}, {0, 0, 1}, 0.25}, {0, 0.25, 0.5}));
  EXPECT_TRUE(contains(CapsuleRegionConfig{{0, 0, 0}, {0, 0, 1}, 0.25}, {0, 0, 1.25}));
  EXPECT_FALSE(contains(CapsuleRegionConfig{{0, 0, 0}, {0, 0, 1}, 0.25}, {0, 0.2, 1.2}));
  EXPECT_TRUE(contains(CapsuleRegionConfig{{1, 1, 1}, {1, 1, 1}, 0.25}, {1, 1, 1.25}));
  EXPECT_TRUE(contains(HalfspaceRegionConfig{{0, 0, 1}, {0, 0, 1}}, {5, 5, 1}));
  EXPECT_FALSE(contains(HalfspaceRegionConfig{{0, 0, 1}, {0, 0, 1}}, {5, 5, 0.99}));
  const SpheresRegionConfig spheres{{{0, 0, 0}, {3, 0, 0}}, 0.5};
  EXPECT_TRUE(contains(spheres, {0, 0.5, 0}));
  EXPECT_TRUE(contains(spheres, {2.6, 0, 0.1}));
  EXPECT_FALSE(contains(spheres, {1.5, 0, 0}));  // between them
}

TEST(Region, LandmarksBecomeSpheres) {
  const RegionConfig region = LandmarkRegionConfig{"left_foot", 0.03};
  const auto sphere = std::get<SphereRegionConfig>(resolvedRegion(region, AlienShapeConfig{0.4, 0.03}));
  EXPECT_EQ(sphere.center, makeAlien({0.4, 0.03}).landmarks.left_foot);
  EXPECT_EQ(sphere.radius, 0.03);
  EXPECT_NE(rejection([&] { resolvedRegion(region, SphereShapeConfig{0.1}); }).find("only the shape alien"),
            std::string::npos);
}

TEST(Region, TheLastPartWins) {
  BodyConfig body;
  body.name = "slab";
  body.shape = BoxShapeConfig{{1, 1, 1}};
  body.material.parts = {{{1e4, 0.4, 1000}, HalfspaceRegionConfig{{0, 0, 0.5}, {0, 0, 1}}},
                         {{1e5, 0.4, 1000}, SphereRegionConfig{{0, 0, 0.6}, 0.2}}};
  const std::vector<Vec3> points{{0, 0, 0.1}, {0, 0, 0.45}, {0, 0, 0.7}, {0, 0, 0.9}};
  EXPECT_EQ(materialPartsOf(body, points), (std::vector<int>{-1, 1, 1, 0}));
  std::swap(body.material.parts[0], body.material.parts[1]);
  EXPECT_EQ(materialPartsOf(body, points), (std::vector<int>{-1, 0, 1, 1}));
  body.material.parts[0].region = SphereRegionConfig{{0, 0, 5}, 0.2};
  EXPECT_EQ(rejection([&] { materialPartsOf(body, points); }),
            "slab: material.parts[0].region: holds no tetrahedron's centroid; make it larger or the mesh finer");
  body.material.parts.clear();
  EXPECT_EQ(materialPartsOf(body, points), (std::vector<int>{-1, -1, -1, -1}));
}

}  // namespace
}  // namespace palpate
