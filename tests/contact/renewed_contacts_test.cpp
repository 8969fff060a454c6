// The place of a surface that is nearest to a point, and contacts whose features have slid off each other.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "palpate/contact/nearest_place.h"
#include "palpate/contact/surface_contacts.h"
#include "palpate/math/triangle.h"
#include "palpate/mesh/shapes.h"
#include "shared/surface_motions.h"

namespace palpate {
namespace {

TEST(NearestPlace, OfAConvexBodyIsTheNearestOfAll) {
  const CollisionSurface surfaces[] = {CollisionSurface(sphereSurface(0.02, 3)),
                                       CollisionSurface(boxSurface({0.03, 0.05, 0.02}, {6, 8, 5})),
                                       CollisionSurface(capsuleSurface(0.01, 0.04, 16))};
  test::Chance chance(7);
  for (const CollisionSurface& surface : surfaces) {
    for (int i = 0; i < 100; ++i) {
      const Vec3 point = chance.in(0.035, 0.06) * chance.direction();
      double least = std::numeric_limits<double>::infinity();
      std::vector<int> facing;
      for (std::size_t t = 0; t < surface.triangles().size(); ++t) {
        const auto& [a, b, c] = surface.triangles()[t];
        least =
            std::min(least, closestOnTriangle(point, surface.start[a], surface.start[b], surface.start[c]).distance);
        const int own = static_cast<int>(t);
        if (surface.areaNormal(own, 0).dot(point - surface.start[a]) > 0) facing.push_back(own);
      }
      const auto from = static_cast<std::size_t>(chance.in(0, 0.999 * static_cast<double>(facing.size())));
      const NearestPlace place = nearestFrom(surface, std::array{facing[from]}, point);
      EXPECT_NEAR(place.distance, least, 1e-12);
      Vec3 foot = Vec3::Zero();
      for (std::size_t k = 0; k < 3; ++k) {
        foot += place.weight[k] * surface.start[surface.triangles()[static_cast<std::size_t>(place.triangle)][k]];
      }
      EXPECT_LT((foot + place.distance * place.normal - point).norm(), 1e-12);
    }
  }
}

TEST(NearestPlace, TellsInsideFromOutside) {
  const CollisionSurface box(boxSurface({0.02, 0.02, 0.02}, {2, 2, 2}));
  std::vector<int> all(box.triangles().size());
  for (std::size_t t = 0; t < all.size(); ++t) all[t] = static_cast<int>(t);
  for (const double height : {-1e-3, -1e-7, 0.0, 1e-7, 1e-3}) {
    const NearestPlace place = nearestFrom(box, all, {0.001, 0.002, 0.01 + height});
    EXPECT_NEAR(place.distance, height, 1e-12);
    EXPECT_LT((place.normal - Vec3::UnitZ()).norm(), 1e-9) << height;
  }
}

// A block that a cube of 20 mm lies on, near its edge at x = 0.1; it is fixed, or a body before or after the cube.
enum class Block { fixed, first, second };

struct Scene {
  explicit Scene(Block kind) : fixed(kind == Block::fixed), cube(kind == Block::first ? 1 : 0) {
    const auto addCube = [&] { surfaces.addBody(cube, barMesh({0.02, 0.02, 0.02}, {2, 2, 2}), false); };
    if (kind != Block::first) addCube();
    if (fixed) {
      surfaces.addObstacle(0, boxSurface({0.2, 0.2, 0.02}, {8, 8, 2}));
      friction.setObstacle(0, 0.5);
    } else {
      surfaces.addBody(1 - cube, barMesh({0.2, 0.2, 0.02}, {8, 8, 2}), false);
      friction.setBody(1 - cube, 0.5);
    }
    if (kind == Block::first) addCube();
    friction.setBody(cube, 0.5);
  }
  static VecX placed(const SimulationMesh& mesh, const Vec3& by) {
    VecX x(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
    for (std::size_t i = 0; i < mesh.mesh.nodes.size(); ++i)
      x.segment<3>(static_cast<Eigen::Index>(3 * i)) = mesh.mesh.nodes[i] + by;
    return x;
  }
  // The cube's corner of least coordinates is there; nothing moves.
  void put(const Vec3& corner) {
    at = placed(barMesh({0.02, 0.02, 0.02}, {2, 2, 2}), corner);
    surfaces.setStart(cube, at);
    surfaces.setEnd(cube, at);
    if (fixed) return;
    block = placed(barMesh({0.2, 0.2, 0.02}, {8, 8, 2}), {-0.1, -0.1, -0.01});
    surfaces.setStart(1 - cube, block);
    surfaces.setEnd(1 - cube, block);
  }
  std::vector<Contact> found() {
    std::vector<Contact> out;
    surfaces.find(settings, friction, out);
    return out;
  }
  // As if the cube were the first.
  Contact fromCube(const Contact& c) const { return c.first.body == cube ? c : turnedAround(c); }

  SurfaceContacts surfaces;
  FrictionTable friction;
  ContactSettings settings;
  bool fixed;
  int cube;
  VecX at, block;
};

class RenewedContacts : public testing::TestWithParam<Block> {};

// Over the edge and down beside it: what lay on the top is against the side, as far as it is from that.
TEST_P(RenewedContacts, AreAgainstWhatIsThereNow) {
  Scene scene(GetParam());
  scene.put({0.075, 0.003, 0.0101});
  const std::vector<Contact> before = scene.found();
  ASSERT_GE(before.size(), 4u);
  scene.put({0.103, 0.003, 0.004});
  for (const Contact& earlier : before) {
    ASSERT_GT(scene.fromCube(earlier).normal.z(), 0.99);
    Contact contact = earlier;
    scene.surfaces.renew(scene.cube, contact);
    const Contact c = scene.fromCube(contact);
    const Vec3 place = c.first.at(scene.at);
    EXPECT_LT((c.normal - Vec3::UnitX()).norm(), 1e-9);
    EXPECT_NEAR(c.gap, place.x() - 0.1 - c.thickness, 1e-9);
    if (!scene.fixed) {
      EXPECT_LT((c.second.at(scene.block) - Vec3(0.1, place.y(), place.z())).norm(), 1e-9);
    }
    const SurfaceFeature on = scene.surfaces.featureOn(scene.fixed ? -1 : 1 - scene.cube, contact);
    ASSERT_EQ(on.corners.size(), 3u);
    for (const Vec3& corner : on.corners) EXPECT_NEAR(corner.x(), 0.1, 1e-12);
    EXPECT_EQ(contact.key, earlier.key);
    EXPECT_EQ(contact.friction, earlier.friction);
  }
}

// The edge itself is against another place of the same face: its plane is the one of before.
TEST_P(RenewedContacts, OfAnEdgeOnAFaceStay) {
  Scene scene(GetParam());
  scene.put({0.095, 0.003, 0.0101});
  std::vector<Contact> before = scene.found();
  std::erase_if(before,
                [&](const Contact& c) { return std::abs(scene.fromCube(c).first.at(scene.at).x() - 0.1) > 1e-4; });
  ASSERT_FALSE(before.empty());
  scene.put({0.098, 0.003, 0.0102});
  for (const Contact& earlier : before) {
    Contact contact = earlier;
    scene.surfaces.renew(scene.cube, contact);
    EXPECT_EQ(contact.gap, 0.0);
    contact.gap = earlier.gap;
    EXPECT_TRUE(contact == earlier);
  }
}

INSTANTIATE_TEST_SUITE_P(All, RenewedContacts, testing::Values(Block::fixed, Block::first, Block::second));

}  // namespace
}  // namespace palpate
