// A visual step on several threads: the same as on one, to the last bit, and without races (ThreadSanitizer).
#include <gtest/gtest.h>

#include <optional>
#include <vector>

#include "palpate/threads/thread_team.h"
#include "shared/contact_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kStep = 0.033;

struct Scene {
  World world;
  Vec3 hand = Vec3::Zero();  // velocity of the device [m/s]
  int steps = 0;
};

// Pressed and dragged: well over a hundred contacts that all act on one another.
Scene plate() { return {plateOverBlock(14, 12.4), Vec3(0.02, 0.01, -0.02), 6}; }

// Of two sizes: islands, and bodies that are begun at the same time.
Scene blocks() { return {slidingBlocks(5, 3), Vec3::Zero(), 8}; }

// With fine surfaces, one pressed on the other; both may touch themselves.
Scene balls() {
  EmbedOptions options;
  options.target_tetrahedra = 300;
  BallOptions pressed;
  pressed.offset += Vec3(0.004, 0.002, 0);
  pressed.self_contact = true;
  return {ballOverBall(embedSurface(ballSurface(0.006), options), pressed), Vec3(0.05, 0, -0.15), 8};
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
  if (scene.world.hasTool()) device.pose = scene.world.tool().state.handle.pose;
  device.twist.head<3>() = scene.hand;
  for (int n = 0; n < scene.steps; ++n) {
    device.pose.position += kStep * scene.hand;
    const StepReport report = scene.world.step(device, kStep);
    EXPECT_NE(report.status, StepStatus::restored);
    out.impulses.push_back(scene.world.contacts().impulse);
    out.most_contacts = std::max(out.most_contacts, report.contacts);
  }
  for (int i = 0; i < scene.world.bodies(); ++i) {
    out.positions.push_back(scene.world.body(i).state.positions);
    out.velocities.push_back(scene.world.body(i).state.velocities);
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
}  // namespace palpate
