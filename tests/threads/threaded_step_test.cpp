// A visual step on several threads: the same as on one, to the last bit, and without races (ThreadSanitizer).
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <thread>
#include <vector>

#include "palpate/threads/thread_team.h"
#include "palpate/visual/live_step.h"
#include "shared/contact_scenes.h"
#include "shared/lattice_matrices.h"

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
Scene ballsOf(double lower_handle) {
  EmbedOptions options;
  options.target_tetrahedra = 300;
  BallOptions pressed;
  pressed.offset += Vec3(0.004, 0.002, 0);
  pressed.self_contact = true;
  pressed.lower_handle = lower_handle;
  return {ballOverBall(embedSurface(ballSurface(0.006), options), pressed), Vec3(0.05, 0, -0.15), 8};
}

Scene balls() { return ballsOf(0); }
Scene ballOverHeavyBall() { return ballsOf(20); }

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

// What method `live` does beside the world's step and beside its factorization as well.
std::vector<LiveModel> modelsOf(Scene scene, int steps, int threads) {
  constexpr double kTick = 0.001;
  std::optional<ThreadTeam> team;
  if (threads > 0) team.emplace(threads);
  const ExecutorScope scope(team ? &*team : nullptr);
  LiveSettings settings;
  settings.second_order = 2;
  LiveVisual live(settings, kTick);
  World& world = scene.world;
  DeviceTarget device;
  device.pose = world.tool().state.handle.pose;
  device.twist.head<3>() = scene.hand;
  EXPECT_FALSE(world.evaluate(device, kStep).failed());
  HandlePath path;
  PathPoint point{0, device.pose, device.twist};
  path.add(point);
  live.begin(world, kStep, 0, 0.0);
  std::vector<LiveModel> out;
  VisualStepSettings step;
  step.step = kStep;
  for (int n = 0; n < steps; ++n) {
    for (int k = 0; k < 33; ++k) {
      ++point.index;
      point.pose.position += kTick * scene.hand;
      path.add(point);
    }
    device.pose = point.pose;
    const VisualRecord record = live.step(world, path, device, step, (n + 1) * kStep, {});
    EXPECT_NE(record.step.status, StepStatus::restored);
    out.push_back(live.model());
  }
  return out;
}

void expectSameModels(Scene (*make)(), int steps, int least_contacts) {
  const std::vector<LiveModel> alone = modelsOf(make(), steps, 0);
  int most = 0;
  for (const LiveModel& model : alone) {
    most = std::max(most, model.contacts);
  }
  EXPECT_GE(most, least_contacts);
  for (const int threads : {1, 2, 3}) {
    const std::vector<LiveModel> together = modelsOf(make(), steps, threads);
    for (std::size_t n = 0; n < alone.size(); ++n) {
      const LiveModel &a = alone[n], &b = together[n];
      ASSERT_EQ(a.contacts, b.contacts) << threads << " threads, step " << n;
      ASSERT_EQ(a.modes(), b.modes()) << threads << " threads, step " << n;
      EXPECT_TRUE(a.squared_frequency == b.squared_frequency) << threads << " threads, step " << n;
      EXPECT_TRUE(a.compliance == b.compliance) << threads << " threads, step " << n;
      EXPECT_TRUE(a.shape == b.shape) << threads << " threads, step " << n;
      EXPECT_TRUE(a.curvature == b.curvature) << threads << " threads, step " << n;
      EXPECT_TRUE(a.arm == b.arm && a.torque == b.torque) << threads << " threads, step " << n;
      EXPECT_TRUE(a.force == b.force && a.speed == b.speed) << threads << " threads, step " << n;
      EXPECT_TRUE(a.contact_force == b.contact_force) << threads << " threads, step " << n;
    }
  }
}

// One column goes through the subtrees of the factor, a few go in two chunks; with contact last and without.
TEST(ThreadedStep, AFactorSolvesTheSame) {
  const LatticeMatrix bar = barMatrix(8, 8, 9);
  const int rows = 3 * bar.matrix.size;
  const MatX loads = MatX::NullaryExpr(
      rows, 40, [](Eigen::Index i, Eigen::Index j) { return std::sin(static_cast<double>(3 * i + 7 * j)); });
  for (const std::vector<int>& last : {std::vector<int>(), bar.bottom}) {
    SparseCholesky factor;
    factor.analyze(bar.matrix, last, SparseCholesky::Numeric::compact);
    ASSERT_TRUE(factor.factorize(bar.matrix));
    ASSERT_GT(factor.statistics().nonzeros, 150'000U);  // worth its parts
    const auto below = static_cast<Eigen::Index>(3 * last.size());
    for (const int columns : {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 17, 25, 40}) {
      MatX alone = loads.leftCols(columns), from_last = MatX::Zero(rows, columns);
      factor.solve(alone);
      factor.solveFromTrailing(loads.topLeftCorner(below, columns), from_last);
      EXPECT_LT((bar.matrix.multiplyColumns(alone) - loads.leftCols(columns)).norm(), 1e-10 * alone.norm()) << columns;
      for (const int threads : {1, 2, 4}) {
        ThreadTeam team(threads);
        const ExecutorScope scope(&team);
        MatX again = loads.leftCols(columns), again_from_last = MatX::Zero(rows, columns);
        factor.solve(again);
        factor.solveFromTrailing(loads.topLeftCorner(below, columns), again_from_last);
        EXPECT_TRUE(again == alone) << columns << " columns, " << threads << " threads";
        EXPECT_TRUE(again_from_last == from_last) << columns << " columns, " << threads << " threads";
      }
    }
  }
}

// As a live model is made: the one by a task, the other by who offered it.
TEST(ThreadedStep, AFactorFormsGramMatricesWhileItSolves) {
  World world = plate().world;
  DeviceTarget device;
  device.pose = world.tool().state.handle.pose;
  ASSERT_FALSE(world.evaluate(device, kStep).failed());
  const Body tool = world.tool();
  SparseCholesky& factor = tool.system.factor();
  const int n = tool.model.freeNodes();
  BlockColumns columns;
  for (int k = 0; k < 100; ++k) {  // in several parts
    columns.add(k * n / 100, Mat3::Identity());
    columns.add(7 * k % n, -Mat3::Identity());
    columns.close();
  }
  const MatX loads = MatX::NullaryExpr(
      3 * n, 20, [](Eigen::Index i, Eigen::Index j) { return std::sin(static_cast<double>(i + 7 * j)); });
  MatX gram, solution = loads;
  factor.gram(columns, gram);
  factor.solve(solution);
  for (const int threads : {2, 3}) {
    ThreadTeam team(threads);
    const ExecutorScope scope(&team);
    MatX shared;
    factor.gram(columns, shared);
    EXPECT_TRUE(MatX(shared.triangularView<Eigen::Lower>()) == MatX(gram.triangularView<Eigen::Lower>())) << threads;
  }
  for (int round = 0; round < 20; ++round) {
    MatX other;
    std::thread beside([&] { factor.gram(columns, other); });
    MatX again = loads;
    factor.solve(again);
    factor.solve(again.col(0));
    factor.solve(again.leftCols(2));
    beside.join();
    EXPECT_TRUE(MatX(other.triangularView<Eigen::Lower>()) == MatX(gram.triangularView<Eigen::Lower>()));
    EXPECT_TRUE(again.rightCols(18) == solution.rightCols(18));
  }
}

TEST(ThreadedStep, TheLiveModelIsTheSame) {
  expectSameModels(plate, 2, 8);
  expectSameModels(ballOverHeavyBall, 5, 3);
}

}  // namespace
}  // namespace palpate
