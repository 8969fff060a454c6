// Bodies at rest on every kind of obstacle: weight, depth of every surface vertex; what reduction and order change.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <optional>

#include "palpate/linearization/linearize.h"
#include "palpate/mesh/embed_surface.h"
#include "shared/bunny.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kDepth = 5e-5;  // [m]

// Puts the lowest surface vertex at the given height.
SimulationMesh standing(SimulationMesh mesh, double height = 0.0) {
  double lowest = 1e300;
  for (const EmbeddedPoint& e : mesh.embedding) {
    double z = 0;
    for (int k = 0; k < 4; ++k) z += e.weights[k] * mesh.mesh.nodes[mesh.mesh.tetrahedra[e.tetrahedron][k]].z();
    lowest = std::min(lowest, z);
  }
  return moved(std::move(mesh), {Vec3(0, 0, height - lowest), Quat::Identity()});
}

SimulationMesh embedded(const Surface& surface, int tetrahedra) {
  EmbedOptions options;
  options.target_tetrahedra = tetrahedra;
  options.count_tolerance = 0.1;
  return embedSurface(surface, options);
}

// Drops the body from where it stands, waits, and checks weight and depth.
void expectRests(World& world, double seconds, double h = 0.02, double facets = 0) {
  for (int n = 0; n < static_cast<int>(seconds / h); ++n) {
    const StepReport report = world.step({}, h);
    if (n == 0 && facets > 0) {  // starts at distance zero, where normals between triangles are a guess
      ASSERT_NE(report.status, StepStatus::restored);
    } else {
      ASSERT_EQ(report.status, StepStatus::ok);
    }
    EXPECT_LT(report.penetration, kDepth);
    EXPECT_LT(deepestVertex(world, 0), kDepth + facets);
  }
  const ContactForce force = contactForce(world, 0);
  const Vec3 weight = world.body(0).model.totalMass() * world.gravity;
  EXPECT_LT((force.total + weight).norm(), 1e-3 * weight.norm());
}

World restingWorld(SimulationMesh mesh, double friction = 0.5) {
  Material material;
  material.damping_alpha = 2.0;  // so that a rocking body comes to rest
  material.damping_beta = 0.01;
  World world;
  world.obstacles = {ground(friction)};
  world.add(BodyModel("body", std::move(mesh), material));
  return world;
}

TEST(Resting, BarOnTheGround) {
  for (const double friction : {0.0, 0.5}) {
    World world = restingWorld(barMesh(kBarSize, {4, 3, 3}), friction);
    expectRests(world, 1.5);
    EXPECT_NEAR(contactForce(world, 0).normal, 9.81 * world.body(0).model.totalMass(), 1e-3);
  }
}

TEST(Resting, EmbeddedBoxOnTheGround) {
  World world = restingWorld(standing(embedded(boxSurface(kBarSize, {6, 4, 3}), 120)));
  expectRests(world, 2.0);
}

TEST(Resting, EmbeddedSphereOnTheGround) {
  World world = restingWorld(standing(embedded(sphereSurface(0.03, 4), 120)));
  expectRests(world, 2.5);
}

TEST(Resting, SettledBodyStaysSettled) {
  World world = restingWorld(standing(embedded(boxSurface(kBarSize, {6, 4, 3}), 120)));
  world.settle({0}, Pose{});
  const Vec3 before = center(world.body(0));
  expectRests(world, 0.2);
  EXPECT_LT((center(world.body(0)) - before).norm(), 1e-7);
}

TEST(Resting, BunnyOnTheGround) {
  if (!std::filesystem::exists(kBunnyFile)) GTEST_SKIP() << "the scan is in Debian's glmark2-data";
  World world = restingWorld(standingBunny(300));
  world.settle({0}, Pose{});
  expectRests(world, 0.2);
}

struct Ground {
  const char* name;
  Obstacle obstacle;
  double facets = 0;  // how far the triangles lie below the round solid [m]
};
class OnSupport : public ::testing::TestWithParam<Ground> {};

TEST_P(OnSupport, BarRests) {
  World world = restingWorld(moved(barMesh(kBarSize, {6, 4, 2}), {Vec3(-0.03, -0.02, 0), Quat::Identity()}), 0.8);
  world.obstacles = {GetParam().obstacle};
  expectRests(world, 2.0, 0.01, GetParam().facets);
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, OnSupport,
    ::testing::Values(
        Ground{"box", {BoxShape{{Vec3(0, 0, -0.05), Quat::Identity()}, Vec3(0.1, 0.1, 0.05)}, 0.8, ""}},
        Ground{"narrow_box", {BoxShape{{Vec3(0, 0, -0.05), Quat::Identity()}, Vec3(0.0251, 0.0151, 0.05)}, 0.8, ""}},
        Ground{"sphere", {SphereShape{Vec3(0, 0, -0.5), 0.5}, 0.8, ""}, 1.2e-3 * 0.5},
        Ground{"capsule", {CapsuleShape{Vec3(-0.1, 0, -0.3), Vec3(0.1, 0, -0.3), 0.3}, 0.8, ""}, 2.5e-3 * 0.3}),
    [](const auto& support) { return std::string(support.param.name); });

World pressedBar(bool reduce) {
  World world;
  world.link = {700, 2, 1.0, 0.01};
  world.contact.reduction = reduce;
  world.obstacles = {ground(0.5)};
  BodyModel body("body", standing(embedded(boxSurface(kBarSize, {9, 6, 5}), 150)), {});
  const double top = kBarSize.z() - 0.008;
  holdNodes(body, [&](const Vec3& p) { return p.z() > top; });
  world.add(std::move(body));
  const Pose start = world.tool().state.handle.pose;
  for (int n = 1; n <= 30; ++n) {
    Vec6 offset = Vec6::Zero();
    offset[2] = -0.003 * std::min(1.0, n / 15.0);
    offset[0] = 0.005 * n / 30.0;
    EXPECT_EQ(world.step({advance(start, offset), Vec6::Zero()}, 0.02).status, StepStatus::ok);
  }
  return world;
}

// What every vertex as a contact gives, the few chosen ones must give.
TEST(Reduction, KeepsTheForceOfAllPoints) {
  const World all = pressedBar(false);
  const World few = pressedBar(true);
  EXPECT_LT(few.contacts().contacts.size(), all.contacts().contacts.size());
  const Vec6 a = couplingWrench(all);
  const Vec6 b = couplingWrench(few);
  EXPECT_GT(a.head<3>().norm(), 1.0);
  EXPECT_LT((a - b).head<3>().norm(), 0.01 * a.head<3>().norm());
  EXPECT_LT((a - b).tail<3>().norm(), 0.02 * a.head<3>().norm() * kBarSize.x());
  EXPECT_LT(deepestVertex(few, 0), kDepth);
}

TEST(Contact, OrderOfObstaclesDoesNotMatter) {
  const auto run = [](bool turned) {
    World world = restingWorld(moved(barMesh(kBarSize, {3, 2, 2}), {Vec3(0, 0, 0.002), Quat::Identity()}));
    world.obstacles = {ground(0.5),
                       {BoxShape{{Vec3(0.11, 0, 0), Quat::Identity()}, Vec3(0.04, 0.2, 0.2)}, 0.3, "wall"},
                       {SphereShape{Vec3(0.02, 0.1, 0.02), 0.05}, 0.2, "ball"}};
    if (turned) std::swap(world.obstacles[0], world.obstacles[2]);
    world.gravity = Vec3(3, 3, -9);
    for (int n = 0; n < 60; ++n) EXPECT_EQ(world.step({}, 0.01).status, StepStatus::ok);
    return world;
  };
  const World a = run(false);
  const World b = run(true);
  EXPECT_GT(a.contacts().active(), 4);
  EXPECT_LT((a.body(0).state.positions - b.body(0).state.positions).cwiseAbs().maxCoeff(), 1e-6);
}

}  // namespace
}  // namespace palpate
