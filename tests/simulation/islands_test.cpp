// Contacts fall apart into islands, each with a matrix of its own, built up over the passes of a step.
#include <gtest/gtest.h>

#include <set>

#include "shared/pair_scenes.h"

namespace palpate {
namespace {

using namespace test;

struct Seen {
  int islands = 0;  // most in one step
  int bodies = 0;   // most in one island
  int passes = 0;   // most
  int contacts = 0;
};

// W lambda + free must be what the bodies' own end velocities say, and islands must share nothing.
void expectConsistent(const World& world, Seen& seen, int step) {
  const ContactSet& set = world.contacts();
  const VecX rows = set.rowVelocity();
  ASSERT_EQ(rows.size(), static_cast<Eigen::Index>(3 * set.contacts.size()));
  double speed = 1e-3;
  for (int b = 0; b < world.bodies(); ++b) speed = std::max(speed, fastest(world.body(b)));
  std::set<int> bodies;
  std::size_t contacts = 0;
  for (std::size_t k = 0; k < set.islands.size(); ++k) {
    const ContactIsland& island = set.islands[k];
    for (const int b : island.bodies) EXPECT_TRUE(bodies.insert(b).second) << "step " << step;
    EXPECT_EQ((island.delassus - island.delassus.transpose()).norm(), 0.0);
    for (std::size_t j = 0; j < island.contacts.size(); ++j) {
      const int i = island.contacts[j];
      EXPECT_EQ(set.island[i], static_cast<int>(k));
      EXPECT_EQ(set.place[i], static_cast<int>(j));
      const Contact& c = set.contacts[i];
      const Vec3 v = c.frame() * (endVelocity(world, c.first) - endVelocity(world, c.second));
      EXPECT_LT((v - rows.segment<3>(3 * i)).norm(), 1e-9 * speed) << "step " << step << " contact " << i;
    }
    contacts += island.contacts.size();
    seen.bodies = std::max(seen.bodies, static_cast<int>(island.bodies.size()));
  }
  EXPECT_EQ(contacts, set.contacts.size());
  seen.islands = std::max(seen.islands, static_cast<int>(set.islands.size()));
  seen.passes = std::max(seen.passes, set.passes);
  seen.contacts = std::max(seen.contacts, static_cast<int>(contacts));
}

void addGround(World& world) { world.obstacles.push_back({PlaneShape{}, 0.4, "ground"}); }

// A rigid box falls on a soft one, tilted.
void addStack(World& world, double x) {
  const Vec3 size(0.04, 0.04, 0.02);
  world.add(box(Kind::soft, "lower", size, at({x, 0, 0.0105})));
  const Pose tilted{{x + 0.003, 0, 0.042}, expRotation(Vec3(0.2, 0.1, 0.3))};
  world.add(box(Kind::rigid, "upper", Vec3(0.03, 0.03, 0.02), tilted));
}

TEST(Islands, RowVelocitiesAreThoseOfTheBodies) {
  for (const double h : {0.005, 0.033}) {
    World world;
    addGround(world);
    addStack(world, 0.0);
    addStack(world, 0.3);
    // slides along and joins the stacks to one island
    world.add(box(Kind::soft, "thrown", Vec3(0.04, 0.04, 0.03), at({-0.1, 0, 0.016}), {}, moving({1.5, 0, 0})));
    Seen seen;
    for (int n = 0; n < static_cast<int>(0.5 / h); ++n) {
      ASSERT_NE(world.step({}, h).status, StepStatus::restored);
      expectConsistent(world, seen, n);
      if (HasFatalFailure()) return;
    }
    EXPECT_GE(seen.islands, 3);
    EXPECT_GE(seen.bodies, 3);
    EXPECT_GE(seen.passes, 2);
  }
}

// Contact on so many nodes that they are not ordered last: W then comes from the whole factor.
TEST(Islands, ContactOnManyNodes) {
  World world;
  addGround(world);
  BoxOptions plate;
  plate.cells = {12, 12, 2};
  world.add(box(Kind::soft, "plate", Vec3(0.12, 0.12, 0.02), at({0, 0, 0.0101}), plate));
  world.add(box(Kind::soft, "weight", Vec3(0.05, 0.05, 0.03), at({0, 0, 0.0362})));
  Seen seen;
  for (int n = 0; n < 4; ++n) {
    ASSERT_NE(world.step({}, 0.02).status, StepStatus::restored);
    expectConsistent(world, seen, n);
    if (HasFatalFailure()) return;
  }
  EXPECT_GE(seen.contacts, 80);
  EXPECT_EQ(world.body(0).system.factor().statistics().last, 0);
  EXPECT_GT(world.body(1).system.factor().statistics().last, 0);
}

// Stacks apart move as each would alone, in whatever order they come.
TEST(Islands, DoNotDependOnOneAnother) {
  const std::vector<std::vector<double>> scenes{{0.0}, {0.3}, {0.0, 0.3}, {0.3, 0.0}};
  std::vector<World> worlds(scenes.size());
  for (std::size_t w = 0; w < scenes.size(); ++w) {
    addGround(worlds[w]);
    for (const double x : scenes[w]) addStack(worlds[w], x);
  }
  for (int n = 0; n < 40; ++n) {
    for (World& world : worlds) ASSERT_NE(world.step({}, 0.005).status, StepStatus::restored);
    for (int b = 0; b < 2; ++b) {
      const auto differ = [&](std::size_t alone, std::size_t both, int body) {
        return (worlds[alone].body(b).state.positions - worlds[both].body(body).state.positions).cwiseAbs().maxCoeff();
      };
      EXPECT_LT(differ(0, 2, b), 1e-9) << "step " << n;
      EXPECT_LT(differ(1, 2, b + 2), 1e-9) << "step " << n;
      EXPECT_LT(differ(0, 3, b + 2), 1e-9) << "step " << n;
      EXPECT_LT(differ(1, 3, b), 1e-9) << "step " << n;
    }
  }
}

}  // namespace
}  // namespace palpate
