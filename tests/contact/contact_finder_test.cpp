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

std::vector<Obstacle> surroundings() {
  return {{PlaneShape{Vec3(0, 0, -0.047), Vec3::UnitZ()}, 0.5, "ground"},
          {SphereShape{Vec3(0.08, 0, 0), 0.035}, 0.5, "ball"},
          {BoxShape{{Vec3(0, 0.09, 0), expRotation({0.1, 0.2, 0.3})}, Vec3::Constant(0.043)}, {}, "box"},
          {CapsuleShape{Vec3(-0.07, 0, -0.1), Vec3(-0.07, 0, 0.1), 0.025}, 0.5, "rod"}};
}

TEST(ContactFinder, FindsEveryVertexThatBruteForceFinds) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh, 0.7);
  const auto obstacles = surroundings();
  constexpr double kReach = 0.001;
  std::vector<Contact> found;
  finder.find(3, c.x, c.x, obstacles, kReach, false, found);
  std::set<std::pair<int, int>> expected, keys;
  for (int o = 0; o < static_cast<int>(obstacles.size()); ++o) {
    for (int v = 0; v < static_cast<int>(c.mesh.embedding.size()); ++v) {
      if (proximity(obstacles[o], vertexPosition(c, v)).gap < kReach) expected.emplace(o, v);
    }
  }
  for (const Contact& k : found) {
    const int vertex = static_cast<int>(k.key & 0xffffffff);
    keys.emplace(k.partner, vertex);
    EXPECT_LT((k.position - vertexPosition(c, vertex)).norm(), 1e-15);
    EXPECT_EQ(k.first.body, 3);
    EXPECT_EQ(k.second.body, -1);
    EXPECT_EQ(k.friction, k.partner == 2 ? 0.7 : 0.5);  // the box has none of its own
    EXPECT_LT((k.frame() * k.frame().transpose() - Mat3::Identity()).norm(), 1e-14);
    EXPECT_NEAR(k.frame().determinant(), 1.0, 1e-14);
  }
  EXPECT_GT(expected.size(), 40u);
  EXPECT_EQ(keys, expected);
  EXPECT_EQ(found.size(), keys.size());
}

TEST(ContactFinder, NearbyNodesHoldEveryContact) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh, 0.7);
  const auto obstacles = surroundings();
  std::vector<Contact> found;
  finder.find(0, c.x, c.x, obstacles, 0.001, false, found);
  std::vector<int> nodes;
  finder.nearbyNodes(c.x, obstacles, 0.001, nodes);
  const std::set<int> unique(nodes.begin(), nodes.end());
  EXPECT_EQ(unique.size(), nodes.size());
  for (const Contact& k : found) {
    for (const int n : k.first.node) EXPECT_TRUE(unique.count(n));
  }
}

// gap + n . (x_end - x_start) is the end gap for a plane wherever it is linearized.
TEST(ContactFinder, GapsAreLinearizedAtStartOrEnd) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh, 0.7);
  VecX before = c.x;
  for (Eigen::Index i = 0; i < before.size(); i += 3) before.segment<3>(i) += Vec3(0.003, 0.001, 0.01);
  for (const bool at_end : {false, true}) {
    std::vector<Contact> found;
    finder.find(0, before, c.x, surroundings(), 0.001, at_end, found);
    for (const Contact& k : found) {
      if (k.partner == 0 || at_end) {
        EXPECT_NEAR(k.gap - k.normal.dot(Vec3(0.003, 0.001, 0.01)), k.end_gap, 1e-14);
      }
    }
  }
}

TEST(Reduction, KeepsTheDeepestAndSpreadsTheRest) {
  const Case& c = sphere();
  const ContactFinder finder(c.mesh, 0.7);
  std::vector<Contact> found;
  finder.find(0, c.x, c.x, {{PlaneShape{Vec3(0, 0, -0.035), Vec3::UnitZ()}, 0.5, "ground"}}, 0.0, false, found);
  const double spacing = 0.4 * finder.edgeLength();
  const std::vector<int> chosen = reduceContacts(found, {}, spacing);
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
  const ContactFinder finder(c.mesh, 0.7);
  std::vector<Contact> found;
  finder.find(0, c.x, c.x, surroundings(), 0.001, false, found);
  std::vector<std::int64_t> kept{found[1].key, found[5].key, found[6].key};
  std::sort(kept.begin(), kept.end());
  const auto keysOf = [&](const std::vector<Contact>& contacts) {
    std::set<std::int64_t> keys;
    for (const int i : reduceContacts(contacts, kept, 0.4 * finder.edgeLength())) keys.insert(contacts[i].key);
    return keys;
  };
  const auto keys = keysOf(found);
  for (const std::int64_t k : kept) EXPECT_TRUE(keys.count(k));
  std::vector<Contact> turned(found.rbegin(), found.rend());
  EXPECT_EQ(keysOf(turned), keys);
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
