// A visual step on several threads: the same as on one, to the last bit, and without races (ThreadSanitizer).
#include <gtest/gtest.h>

#include <optional>
#include <vector>

#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/implicit_surface.h"
#include "palpate/threads/thread_team.h"
#include "shared/held_scenes.h"

namespace palpate::test {
namespace {

constexpr double kStep = 0.033;
const Material kFoam{2.0e4, 0.4, 100.0, 0.0, 0.002};

struct Scene {
  World world;
  Vec3 hand = Vec3::Zero();  // velocity of the device [m/s]
  int steps = 0;
};

// A plate pressed and dragged on a block: well over a hundred contacts that all act on one another.
Scene plate() {
  constexpr int kCells = 14;
  constexpr double kCell = 0.005;
  Scene scene;
  scene.steps = 6;
  World& world = scene.world;
  world.gravity.setZero();
  Body body("plate", barMesh(Vec3(kCells * kCell, kCells * kCell, 2 * kCell), {kCells, kCells, 2}), kFoam);
  world.contact.thickness = 0.002 * boundsOf(body.mesh().surface.vertices).diagonal();
  holdNodes(body, [](const Vec3& p) { return p.z() > 1.5 * kCell; });
  world.add(std::move(body));
  const double middle = 0.5 * kCells * kCell;
  const Vec3 half(6.2 * kCell, 6.2 * kCell, 0.02);
  BoxShape block{{Vec3(middle, middle, -half.z() - 2 * world.contact.thickness), Quat::Identity()}, half};
  world.obstacles.push_back({block, 0.5, "block"});
  scene.hand = Vec3(0.02, 0.01, -0.02);
  return scene;
}

// Blocks of several sizes on an incline: islands, and bodies that are begun at the same time.
Scene blocks() {
  Scene scene;
  scene.steps = 8;
  scene.world.gravity = Vec3(4.0, 0, -9.0);
  scene.world.obstacles.push_back({PlaneShape{}, 0.3, "incline"});
  for (int i = 0; i < 5; ++i) {
    const int cells = 2 + i % 2;
    const SimulationMesh mesh = barMesh(Vec3(0.04, 0.04, 0.04), {cells, cells, cells});
    scene.world.add(Body("block", moved(mesh, {Vec3(0, 0.08 * i, 0), Quat::Identity()}), kFoam, 0.3));
  }
  return scene;
}

// Two balls with fine surfaces, one pressed on the other; both may touch themselves.
Scene balls() {
  constexpr double kRadius = 0.05;
  Scene scene;
  scene.steps = 8;
  const auto distance = [](const Vec3& x) { return sphereDistance(x, Vec3::Zero(), kRadius); };
  const Surface surface =
      meshImplicit(distance, {Vec3::Constant(-1.1 * kRadius), Vec3::Constant(1.1 * kRadius)}, 0.006);
  EmbedOptions options;
  options.target_tetrahedra = 300;
  const SimulationMesh mesh = embedSurface(surface, options);
  World& world = scene.world;
  world.gravity.setZero();
  world.contact.thickness = 0.002 * boundsOf(surface.vertices).diagonal();
  Body upper("upper", moved(mesh, {Vec3(0.004, 0.002, 2 * kRadius), Quat::Identity()}), kFoam, 0.5);
  holdNodes(upper, [](const Vec3& p) { return p.z() > 2.5 * kRadius; });
  Body lower("lower", mesh, kFoam, 0.5);
  world.add(std::move(upper), true);
  world.add(std::move(lower), true);
  scene.hand = Vec3(0.05, 0, -0.15);
  return scene;
}

struct Outcome {
  std::vector<VecX> positions, velocities;
  std::vector<VecX> impulses;
  int most_contacts = 0;
};

Outcome run(Scene scene, int threads) {
  std::optional<ThreadTeam> team;
  if (threads > 0) team.emplace(threads);
  const ExecutorScope scope(team ? &*team : nullptr);
  Outcome out;
  DeviceTarget device;
  if (scene.world.hasTool()) device.pose = scene.world.tool().handle().pose;
  device.twist.head<3>() = scene.hand;
  for (int n = 0; n < scene.steps; ++n) {
    device.pose.position += kStep * scene.hand;
    const StepReport report = scene.world.step(device, kStep);
    EXPECT_NE(report.status, StepStatus::restored);
    out.impulses.push_back(scene.world.contacts().impulse);
    out.most_contacts = std::max(out.most_contacts, report.contacts);
  }
  for (int i = 0; i < scene.world.bodies(); ++i) {
    out.positions.push_back(scene.world.body(i).positions());
    out.velocities.push_back(scene.world.body(i).velocities());
  }
  return out;
}

void expectSame(Scene (*make)(), int least_contacts) {
  const Outcome alone = run(make(), 0);
  EXPECT_GE(alone.most_contacts, least_contacts);
  for (const int threads : {1, 2, 3}) {
    const Outcome together = run(make(), threads);
    for (std::size_t n = 0; n < alone.impulses.size(); ++n) {
      ASSERT_EQ(alone.impulses[n].size(), together.impulses[n].size()) << threads << " threads, step " << n;
      EXPECT_TRUE(alone.impulses[n] == together.impulses[n]) << threads << " threads, step " << n;
    }
    for (std::size_t i = 0; i < alone.positions.size(); ++i) {
      EXPECT_TRUE(alone.positions[i] == together.positions[i]) << threads << " threads, body " << i;
      EXPECT_TRUE(alone.velocities[i] == together.velocities[i]) << threads << " threads, body " << i;
    }
  }
}

TEST(ThreadedStep, ManyCoupledContactsAreTheSame) { expectSame(plate, 150); }
TEST(ThreadedStep, IslandsAreTheSame) { expectSame(blocks, 30); }
TEST(ThreadedStep, ContactOfSurfacesIsTheSame) { expectSame(balls, 3); }

}  // namespace
}  // namespace palpate::test
