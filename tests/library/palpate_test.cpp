#include "palpate/palpate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <thread>

// What include/palpate/palpate.h promises, through the shared library.

namespace {

using palpate::DeviceState;
using palpate::InputError;
using palpate::Pose;
using palpate::RunOptions;
using palpate::Scene;
using palpate::Tick;
using palpate::VisualStep;
using palpate::World;

constexpr const char* kCube = R"(
palpate: 1
name: cube
duration: 0.3
method: hsl
tool:
  shape: {bar: {size: [0.06, 0.06, 0.06], cells: [2, 2, 2]}}
  pose: {position: [0, 0, 0.001]}
  material: {youngs_modulus: 2.0e4, poisson_ratio: 0.3}
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.0599], normal: [0, 0, 1]}}
      hand: {smooth: false, keyframes: [{t: 0}, {t: 0.3, position: [0.01, 0, -0.01]}]}
obstacles: [{name: ground, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}]
device: {type: prescribed}
)";

/// A soft box that nobody holds, at rest on the ground.
constexpr const char* kBox = R"(
palpate: 1
name: box
tool: {shape: {sphere: {radius: 0.02}}, tetrahedra: 30, rigid: false, pose: {position: [0, 0, 1]},
       handles: {top: {region: {halfspace: {point: [0, 0, 0.03], normal: [0, 0, 1]}}}}}
bodies:
  - name: box
    shape: {bar: {size: [0.1, 0.08, 0.05], cells: [2, 2, 2]}}
    material: {youngs_modulus: 2.0e5, poisson_ratio: 0.3, density: 500}
    start: settled
obstacles: [{name: ground, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}]
)";

DeviceState pressed(const World& world, double by) {
  DeviceState device{world.start()};
  device.pose.position[2] -= by;
  return device;
}

TEST(LibraryScene, ErrorsNameTheKey) {
  try {
    Scene::parse("palpate: 1\nname: a\ntool: {shape: {sphere: {radius: -1}}}\n", "a.yaml");
    FAIL();
  } catch (const InputError& e) {
    EXPECT_EQ(e.file(), "a.yaml");
    EXPECT_EQ(e.key(), "tool.shape.sphere.radius");
    EXPECT_NE(std::string(e.what()).find("line 3"), std::string::npos);
  }
  EXPECT_THROW(Scene::load("/nowhere/at-all.yaml"), InputError);
}

TEST(LibraryScene, ValuesAreSetByTheirKeys) {
  Scene scene = Scene::parse(kCube);
  EXPECT_EQ(scene.name(), "cube");
  EXPECT_EQ(scene.method(), "hsl");
  scene.set("duration", 2.5).set("visual.step", 0.02).set("method", "vc").set("latency", "0");
  EXPECT_EQ(scene.duration(), 2.5);
  EXPECT_EQ(scene.visualStep(), 0.02);
  EXPECT_EQ(scene.method(), "vc");
  EXPECT_EQ(scene.latency(), 0);
  scene.set("obstacles[1]", "{name: wall, plane: {point: [1, 0, 0], normal: [-1, 0, 0]}}");
  scene.set("tool.handles.top.hand.keyframes[1].t", 0.7);
  const Scene again = Scene::parse(scene.text());
  EXPECT_EQ(again.text(), scene.text());
  EXPECT_NE(again.text().find("wall"), std::string::npos);
}

TEST(LibraryScene, ABadValueLeavesItAsItWas) {
  Scene scene = Scene::parse(kCube);
  const Scene copy = scene;
  const std::string before = scene.text();
  for (const auto& [key, value] : {std::pair("tool.material.youngs_modulus", "-1"), std::pair("tool.colour", "red"),
                                   std::pair("name[0]", "1"), std::pair("obstacles[7]", "{}"), std::pair("a..b", "1"),
                                   std::pair("", "1"), std::pair("obstacles[x]", "1"), std::pair("duration", "[")}) {
    EXPECT_THROW(scene.set(key, value), InputError) << key;
    EXPECT_EQ(scene.text(), before) << key;
  }
  scene.set("duration", 9);
  EXPECT_EQ(copy.text(), before);  // copies are values
}

TEST(LibraryWorld, ViewsAreOfWhatTheStepMoves) {
  World world(Scene::parse(kCube));
  ASSERT_EQ(world.bodies(), 1);
  EXPECT_EQ(world.bodyName(0), "tool");
  EXPECT_FALSE(world.isRigid(0));
  const std::size_t nodes = 27;
  EXPECT_EQ(world.positions(0).size(), 3 * nodes);
  EXPECT_EQ(world.velocities(0).size(), 3 * nodes);
  EXPECT_EQ(world.forces(0).size(), 3 * nodes);
  EXPECT_EQ(world.tetrahedra(0).size(), 4 * 48u);
  EXPECT_EQ(world.surface(0).size() % 3, 0u);
  EXPECT_EQ(world.freeNodes(0).size(), 18u);
  const auto masses = world.masses(0);
  EXPECT_NEAR(std::accumulate(masses.begin(), masses.end(), 0.0), 1000 * 0.06 * 0.06 * 0.06, 1e-9);
  const std::vector<double> before(world.positions(0).begin(), world.positions(0).end());
  world.step(pressed(world, 0.01));
  double moved = 0, off = 0;
  for (const int node : world.freeNodes(0)) {
    for (std::size_t i = 3 * static_cast<std::size_t>(node); i < 3 * static_cast<std::size_t>(node) + 3; ++i) {
      const double step = world.positions(0)[i] - before[i];
      moved = std::max(moved, std::abs(step));
      off = std::max(off, std::abs(step - world.velocities(0)[i] * 0.033));
    }
  }
  EXPECT_GT(moved, 1e-4);
  EXPECT_LT(off, 1e-12);  // x += h v
  EXPECT_THROW((void)world.positions(1), std::out_of_range);
  EXPECT_THROW((void)world.positions(-1), std::out_of_range);
}

TEST(LibraryWorld, StiffnessIsThatOfTheContinuum) {
  const World world(Scene::parse(kBox));
  const palpate::BlockMatrix k = world.stiffness(1);
  ASSERT_EQ(k.rows, 27);
  const auto x = world.positions(1);
  ASSERT_EQ(world.freeNodes(1).size(), 27u);
  // u^T K u of a displacement u = d (e . x) + c
  const auto energy = [&](int d, int e, double c) {
    double sum = 0;
    for (int row = 0; row < k.rows; ++row) {
      for (int b = k.begin[row]; b < k.begin[row + 1]; ++b) {
        const double u = c + (e < 0 ? 0 : x[3 * row + e]), v = c + (e < 0 ? 0 : x[3 * k.column[b] + e]);
        sum += (k.column[b] == row ? 1 : 2) * u * v * k.value[9 * b + 3 * d + d];
      }
    }
    return sum;
  };
  const double volume = 0.1 * 0.08 * 0.05, mu = 2e5 / 2.6, lambda = 2e5 * 0.3 / (1.3 * 0.4);
  EXPECT_NEAR(energy(2, 2, 0.0) / (volume * (lambda + 2 * mu)), 1.0, 0.01);  // hardly pressed by its weight
  EXPECT_NEAR(energy(0, 2, 0.0) / (volume * mu), 1.0, 0.01);
  EXPECT_NEAR(energy(1, -1, 1.0), 0.0, 1e-6 * volume * mu / (0.05 * 0.05));
}

TEST(LibraryWorld, ContactCarriesWhatRestsOnIt) {
  World world(Scene::parse(kBox));
  for (int i = 0; i < 3; ++i) world.step({world.start()});
  double force = 0;
  for (const palpate::Contact& c : world.contacts()) {
    EXPECT_EQ(c.first, 1);
    EXPECT_EQ(c.second, -1);
    EXPECT_NEAR(c.normal[2], 1, 1e-12);
    force += c.force[2];
  }
  EXPECT_NEAR(force, 500 * 0.1 * 0.08 * 0.05 * 9.81, 0.01);
  std::size_t contacts = 0;
  for (const palpate::ContactIsland& island : world.islands()) {
    const std::size_t rows = 3 * island.contacts.size();
    ASSERT_EQ(island.w.size(), rows * rows);
    for (std::size_t i = 0; i < rows; ++i) EXPECT_GT(island.w[rows * i + i], 0);
    contacts += island.contacts.size();
  }
  EXPECT_EQ(contacts, world.contacts().size());
}

TEST(LibraryWorld, AForceBalancesTheElasticOnesOfTheFreeNodes) {
  World world(Scene::parse(kBox));
  const std::vector<double> f = world.forces(1);
  double sum = 0, largest = 0;
  for (std::size_t i = 2; i < f.size(); i += 3) {
    sum += f[i];
    largest = std::max(largest, std::abs(f[i]));
  }
  EXPECT_GT(largest, 0.01);
  EXPECT_NEAR(sum, 0, 1e-9);
}

TEST(LibraryWorld, OnlyAWholeStepCanBeLinearized) {
  World world(Scene::parse(kCube));
  EXPECT_THROW((void)world.linearize(), palpate::RunError);
  const palpate::StepReport report = world.step(pressed(world, 0.001), 0.01);
  ASSERT_EQ(report.redone, 0);
  EXPECT_TRUE(report.sound);
  const palpate::HandleModel model = world.linearize();
  EXPECT_EQ(model.step, 0.01);
  EXPECT_EQ(model.time, 0);
  EXPECT_EQ(model.force, world.couplingWrench());
  EXPECT_LT(model.kx[2 * 6 + 2], -10);
  world.setHandle(world.handle(), {});
  EXPECT_THROW((void)world.linearize(), palpate::RunError);
}

TEST(LibraryWorld, AStateGivenBackMakesItGoOnToTheBit) {
  World world(Scene::parse(kCube));
  world.step(pressed(world, 0.01));
  const std::string saved = world.save();
  const auto go = [](World& of) {
    const DeviceState device = pressed(of, 0.02);
    for (int i = 0; i < 3; ++i) of.step(device);
    return of.save();
  };
  const std::string expected = go(world);
  World other(Scene::parse(kCube), 2);
  other.restore(saved);
  EXPECT_EQ(go(other), expected);  // with another number of threads, too
  EXPECT_THROW(other.restore(saved.substr(1)), InputError);
  World box(Scene::parse(kBox));
  EXPECT_THROW(box.restore(saved), InputError);
}

TEST(LibraryWorld, AStifferBodyPushesBackHarder) {
  World world(Scene::parse(kCube));
  const auto push = [&](double scale) {
    World of(Scene::parse(kCube));
    of.setStiffnessScale(0, scale);
    for (int i = 0; i < 5; ++i) of.step(pressed(of, 0.006));
    return of.couplingWrench()[2];
  };
  EXPECT_GT(push(3), 1.1 * push(1));
  EXPECT_THROW(world.setStiffnessScale(0, 0), InputError);
  EXPECT_THROW(world.setFrictionScale(-1), InputError);
}

// The ten lines at the head of palpate.h are a Run: the same forces to the bit.
TEST(LibraryRun, IsWhatWorldAndLoopDoByThemselves) {
  Scene scene = Scene::parse(kCube);
  scene.set("latency", "0");
  std::vector<palpate::Vector6> sent;
  std::vector<VisualStep> steps;
  RunOptions options;
  options.tick = [&](const Tick& t) { sent.push_back(t.sent); };
  options.visual = [&](const VisualStep& s) { steps.push_back(s); };
  palpate::Run(scene, options).finish();
  ASSERT_EQ(sent.size(), 300u);
  ASSERT_EQ(steps.size(), 10u);

  World world(scene);
  const auto device =
      palpate::prescribedDevice({{{0}, {0.3, {0.01, 0, -0.01}}}, false}, world.start(), palpate::DeviceLimits{});
  palpate::HapticLoop loop(world.hapticSettings());
  world.modelAtRest();
  loop.start(world.start(), world.handle(), 0);
  VisualStep step;
  for (int k = 0; k < 300; ++k) {
    const double t = k * 0.001;
    const DeviceState state = device->sample(t);
    if (k % 33 == 0) step = world.visualStep(state);
    step.model.time = k / 33 * 33 * 0.001;
    ASSERT_EQ(loop.tick(state, &step.model, t).sent, sent[static_cast<std::size_t>(k)]) << k;
    ASSERT_EQ(step.model.kx, steps[static_cast<std::size_t>(k / 33)].model.kx) << k;
  }
  EXPECT_GT(sent.back()[2], 0.1);
}

TEST(LibraryRun, GoesOnFromASavedTickWithAnyMethod) {
  for (const char* method : {"live", "hsl", "hsl-exact", "vc"}) {
    Scene scene = Scene::parse(kCube);
    scene.set("method", method).set("device.type", "simulated");
    palpate::Vector6 last{};
    RunOptions options;
    options.tick = [&](const Tick& t) { last = t.sent; };
    palpate::Run run(scene, options);
    EXPECT_EQ(run.ticks(), 300);
    EXPECT_TRUE(run.advance(150));
    EXPECT_EQ(run.next(), 150);
    const palpate::RunState saved = run.save();
    EXPECT_FALSE(run.advance(1000));
    const palpate::Vector6 expected = last;
    run.restore(saved);
    EXPECT_EQ(run.next(), 150);
    EXPECT_EQ(run.finish().ticks, 300u);
    EXPECT_EQ(last, expected) << method;
    EXPECT_THROW(run.restore({}), InputError);
  }
}

TEST(LibraryRun, RunsOnSeveralThreadsDoNotDisturbEachOther) {
  const auto lastForce = [] {
    palpate::Vector6 last{};
    RunOptions options;
    options.tick = [&](const Tick& t) { last = t.sent; };
    palpate::Run(Scene::parse(kCube), options).finish();
    return last;
  };
  const palpate::Vector6 expected = lastForce();
  std::array<palpate::Vector6, 4> found{};
  std::vector<std::thread> threads;
  for (palpate::Vector6& f : found) threads.emplace_back([&] { f = lastForce(); });
  for (std::thread& t : threads) t.join();
  for (const palpate::Vector6& f : found) EXPECT_EQ(f, expected);
}

TEST(LibraryRun, ADeviceOnADeskHasNoVirtualTime) {
  Scene scene = Scene::parse(kCube);
  scene.set("device", "{type: spacenavigator}");
  EXPECT_THROW(palpate::Run{scene}, InputError);
  EXPECT_NO_THROW(World{scene});  // has no use for it
}

TEST(LibraryRun, StopsWhenAsked) {
  int ticks = 0;
  RunOptions options;
  options.tick = [&](const Tick&) { ++ticks; };
  options.stopped = [&] { return ticks >= 20; };
  const palpate::RunSummary summary = palpate::Run(Scene::parse(kCube), options).finish();
  EXPECT_TRUE(summary.stopped);
  EXPECT_EQ(summary.ticks, 20u);
}

/// Stands still, and notes what it is given.
class Still final : public palpate::Device {
 public:
  const char* name() const noexcept override { return "still"; }
  palpate::DeviceLimits limits() const noexcept override {
    palpate::DeviceLimits limits;
    limits.peak_force = 0.25;
    return limits;
  }
  void begin(const Pose& start, const palpate::Vector6&) noexcept override { pose_ = start; }
  DeviceState sample(double t) noexcept override {
    DeviceState state{pose_};
    state.pose.position[2] -= 0.02 * std::min(t / 0.2, 1.0);
    return state;
  }
  void apply(const palpate::Vector6& wrench, double, double) noexcept override {
    ++applied;
    peak = std::max(peak, std::hypot(wrench[0], wrench[1], wrench[2]));
  }
  int applied = 0;
  double peak = 0;

 private:
  Pose pose_;
};

TEST(LibraryRun, TakesAUsersDeviceWithItsLimits) {
  const auto device = std::make_shared<Still>();
  RunOptions options;
  options.device = device;
  const palpate::RunSummary summary = palpate::Run(Scene::parse(kCube), options).finish();
  EXPECT_EQ(device->applied, 300);
  EXPECT_NEAR(device->peak, 0.25, 1e-9);
  EXPECT_GT(summary.flags[static_cast<std::size_t>(palpate::TickFlag::force_clamped)], 0u);
}

TEST(LibraryRun, RealTimeGivesItsRowsToTheCaller) {
  Scene scene = Scene::parse(kCube);
  scene.set("method", "live");
  std::uint64_t ticks = 0, steps = 0;
  RunOptions options;
  options.tick = [&](const Tick&) { ++ticks; };
  options.visual = [&](const VisualStep&) { ++steps; };
  const palpate::RunSummary summary = palpate::Run::realtime(scene, options);
  EXPECT_EQ(summary.failure, "");
  EXPECT_GT(ticks, 50u);
  EXPECT_GT(steps, 0u);
  EXPECT_EQ(ticks, summary.ticks);
}

}  // namespace
