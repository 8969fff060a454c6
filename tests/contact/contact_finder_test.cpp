// Finding against brute force over all surface vertices; reduction: spread, deepest kept, nothing left uncovered.
#include "palpate/contact/contact_finder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "palpate/math/rotation.h"
#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/shapes.h"

namespace palpate {
namespace {

struct Case {
  SimulationMesh mesh;
  VecX x;
};

// A sphere's surface in a coarse lattice, a little deformed.
const Case& sphere() {
  static const Case result = [] {
    EmbedOptions options;
    options.target_tetrahedra = 120;
    Case c{embedSurface(sphereSurface(0.05, 4), options), {}};
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(-0.002, 0.002);
    c.x.resize(static_cast<Eigen::Index>(3 * c.mesh.mesh.nodes.size()));
    for (std::size_t i = 0; i < c.mesh.mesh.nodes.size(); ++i) {
      c.x.segment<3>(static_cast<Eigen::Index>(3 * i)) =
          c.mesh.mesh.nodes[i] + Vec3(uniform(random), uniform(random), uniform(random));
    }
    return c;
  }();
  return result;
}

Vec3 vertexPosition(const Case& c, int vertex) {
  const EmbeddedPoint& p = c.mesh.embedding[vertex];
  Vec3 sum = Vec3::Zero();
  for (int k = 0; k < 4; ++k) sum += p.weights[k] * c.x.segment<3>(3 * c.mesh.mesh.tetrahedra[p.tetrahedron][k]);
  return sum;
}

// Three planes that the sphere comes near or pokes into, and a solid that is not this finder's business.
std::vector<Obstacle> surroundings() {
  return {{PlaneShape{Vec3(0, 0, -0.047), Vec3::UnitZ()}, 0.5, "ground"},
          {PlaneShape{Vec3(0.045, 0, 0), -Vec3::UnitX()}, 0.5, "wall"},
          {SphereShape{Vec3(0.08, 0, 0), 0.035}, 0.5, "ball"},
          {PlaneShape{Vec3(0, 0.04, 0), Vec3(0.3, -1, 0.2).normalized()}, {}, "slope"}};
}

std::vector<Contact> findAll(const ContactFinder& finder, const VecX& start, const VecX& end, double reach) {
  std::vector<Contact> found;
  finder.find(3, start, end, surroundings(), reach, found);
  return found;
}

TEST(ContactFinder, FindsEveryVertexThatBruteForceFinds) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh);
  const auto obstacles = surroundings();
  constexpr double kReach = 0.001;
  const std::vector<Contact> found = findAll(finder, c.x, c.x, kReach);
  std::set<std::uint64_t> expected, keys;
  for (int o = 0; o < static_cast<int>(obstacles.size()); ++o) {
    const auto* plane = std::get_if<PlaneShape>(&obstacles[o].shape);
    for (int v = 0; plane != nullptr && v < static_cast<int>(c.mesh.embedding.size()); ++v) {
      if (gap(*plane, vertexPosition(c, v)) < kReach) {
        expected.insert(contactKey(3, static_cast<std::uint64_t>(o), static_cast<std::uint64_t>(v)));
      }
    }
  }
  for (const Contact& k : found) {
    keys.insert(k.key);
    EXPECT_EQ(k.key, k.track);
    EXPECT_LT((k.position - k.first.at(c.x)).norm(), 1e-15);
    EXPECT_NEAR(k.end_gap, gap(std::get<PlaneShape>(obstacles[k.partner].shape), k.position), 1e-15);
    EXPECT_EQ(k.first.body, 3);
    EXPECT_EQ(k.second.body, -1);
    EXPECT_FALSE(k.crosses());
    EXPECT_LT((k.frame() * k.frame().transpose() - Mat3::Identity()).norm(), 1e-14);
    EXPECT_NEAR(k.frame().determinant(), 1.0, 1e-14);
  }
  EXPECT_GT(expected.size(), 40u);
  EXPECT_EQ(keys, expected);
  EXPECT_EQ(found.size(), keys.size());
}

TEST(ContactFinder, NearbyNodesHoldEveryContact) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh);
  std::vector<int> nodes;
  finder.nearbyNodes(c.x, surroundings(), 0.001, nodes);
  const std::set<int> unique(nodes.begin(), nodes.end());
  for (const Contact& k : findAll(finder, c.x, c.x, 0.001)) {
    for (int i = 0; i < k.first.count; ++i) EXPECT_TRUE(unique.count(k.first.node[i]));
  }
}

// gap + n . (x_end - x_start) is the end gap.
TEST(ContactFinder, GapsAreThoseOfTheStart) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh);
  const Vec3 shift(0.003, 0.001, 0.01);
  VecX before = c.x;
  for (Eigen::Index i = 0; i < before.size(); i += 3) before.segment<3>(i) += shift;
  const std::vector<Contact> found = findAll(finder, before, c.x, 0.001);
  EXPECT_GT(found.size(), 40u);
  for (const Contact& k : found) EXPECT_NEAR(k.gap - k.normal.dot(shift), k.end_gap, 1e-14);
}

TEST(ContactFinder, FollowsAVertexOutOfReach) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh);
  const std::vector<Contact> found = findAll(finder, c.x, c.x, 0.001);
  VecX away = c.x;
  for (Eigen::Index i = 0; i < away.size(); i += 3) away.segment<3>(i) += Vec3(0, 0, 0.2);
  for (const Contact& k : found) {
    const Contact followed = finder.follow(k, away, away, surroundings());
    EXPECT_EQ(followed.key, k.key);
    EXPECT_NEAR(followed.gap, k.gap + k.normal.dot(Vec3(0, 0, 0.2)), 1e-14);
  }
}

TEST(Reduction, KeepsTheDeepestAndSpreadsTheRest) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh);
  std::vector<Contact> found;
  finder.find(0, c.x, c.x, {{PlaneShape{Vec3(0, 0, -0.035), Vec3::UnitZ()}, 0.5, "ground"}}, 0.0, found);
  const double spacing = 0.4 * finder.edgeLength();
  ContactReduction reduction;
  const std::vector<int> chosen = reduction.choose(found, {}, spacing);
  EXPECT_LT(chosen.size(), found.size() / 4);
  const auto deepest = std::min_element(found.begin(), found.end(),
                                        [](const Contact& a, const Contact& b) { return a.end_gap < b.end_gap; });
  EXPECT_EQ(chosen.front(), deepest - found.begin());
  for (const int i : chosen) {
    for (const int j : chosen) {
      if (i == j) continue;
      EXPECT_GE((found[i].position - found[j].position).norm(), spacing);
    }
  }
  // no patch is farther than the tetrahedra are large from a chosen point
  for (const Contact& k : found) {
    const bool covered = std::any_of(chosen.begin(), chosen.end(), [&](int i) {
      return (found[i].position - k.position).norm() < 1.2 * finder.edgeLength();
    });
    EXPECT_TRUE(covered);
  }
}

TEST(Reduction, KeepsWhatCarriedForceAndDoesNotDependOnOrder) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh);
  const std::vector<Contact> found = findAll(finder, c.x, c.x, 0.001);
  std::vector<std::uint64_t> kept{found[1].track, found[5].track, found[6].track};
  std::sort(kept.begin(), kept.end());
  ContactReduction reduction;
  const auto keysOf = [&](const std::vector<Contact>& contacts) {
    std::set<std::uint64_t> keys;
    for (const int i : reduction.choose(contacts, kept, 0.4 * finder.edgeLength())) keys.insert(contacts[i].key);
    return keys;
  };
  const auto keys = keysOf(found);
  for (const std::uint64_t k : kept) EXPECT_TRUE(keys.count(k));
  std::vector<Contact> turned(found.rbegin(), found.rend());
  EXPECT_EQ(keysOf(turned), keys);
}

// Points of one patch on two sides of an edge bound different motions: both are kept.
TEST(Reduction, SplitsAPatchByDirection) {
  std::vector<Contact> contacts(4);
  for (int i = 0; i < 4; ++i) {
    contacts[i].key = contacts[i].track = static_cast<std::uint64_t>(i);
    contacts[i].normal = i < 2 ? Vec3::UnitZ() : Vec3::UnitX();
    contacts[i].position = Vec3(0, 1e-4 * i, 0);
    contacts[i].end_gap = -1e-3 * i;
  }
  ContactReduction reduction;
  const std::vector<int> chosen = reduction.choose(contacts, {}, 0.01);
  EXPECT_EQ(chosen, (std::vector<int>{3, 1}));
}

TEST(Contact, FirstTangentIsWorldX) {
  Contact c;
  c.normal = Vec3::UnitZ();
  setTangents(c);
  EXPECT_LT((c.tangent1 - Vec3::UnitX()).norm(), 1e-15);
  c.normal = Vec3(0.2, 0.3, 1).normalized();
  setTangents(c);
  EXPECT_GT(c.tangent1.x(), 0.9);
  c.normal = Vec3::UnitX();
  setTangents(c);
  EXPECT_LT((c.tangent1 - Vec3::UnitY()).norm(), 1e-15);
}

}  // namespace
}  // namespace palpate
