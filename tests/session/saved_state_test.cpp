// Every shipped scene, saved in the middle of contact, goes on to the bit: in the same run, and in a world built anew
// with another number of threads.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "palpate/scene/reader.h"
#include "palpate/session/lockstep.h"
#include "palpate/threads/thread_team.h"

namespace palpate {
namespace {

constexpr int kSteps = 50;        // that are compared
constexpr double kSearch = 12.0;  // [s], within which a scene must slide

/// Bytes of plain numbers, so that equal means equal to the bit.
class Bits {
 public:
  void add(const double* values, Eigen::Index count) {
    bits_.append(reinterpret_cast<const char*>(values), static_cast<std::size_t>(count) * sizeof(double));
  }
  void add(double value) { add(&value, 1); }
  void add(const Pose& pose) {
    add(pose.position.data(), 3);
    add(pose.rotation.coeffs().data(), 4);
  }
  template <class Derived>
  void add(const Eigen::PlainObjectBase<Derived>& m) {
    add(m.data(), m.size());
  }
  const std::string& bits() const { return bits_; }

 private:
  std::string bits_;
};

/// What a run hands out, row by row.
struct Rows {
  std::vector<std::string> ticks, impulses, models, positions;
  int sliding = 0;  ///< contacts of the last step

  RunSink sink() {
    RunSink out;
    out.tick = [this](const TickRecord& r) {
      Bits bits;
      for (const double d : {r.time, r.model_age, r.delivered_energy}) bits.add(d);
      for (const Pose* p : {&r.device.pose, &r.proxy}) bits.add(*p);
      for (const Vec6* v : {&r.device.twist, &r.proxy_twist, &r.raw, &r.sent}) bits.add(*v);
      ticks.push_back(bits.bits());
    };
    out.stepped = [this](const World& world, const VisualRecord& r) {
      sliding = r.step.sliding;
      Bits impulse, model, nodes;
      impulse.add(world.contacts().impulse);
      for (const Vec6* v : {&r.model.force, &r.model.twist, &r.model.handle_twist}) model.add(*v);
      for (const Mat6* m : {&r.model.kx, &r.model.kv}) model.add(*m);
      for (const Pose* p : {&r.model.pose, &r.model.handle_pose}) model.add(*p);
      for (const BodyState& body : world.state().bodies) nodes.add(body.positions);
      impulses.push_back(impulse.bits());
      models.push_back(model.bits());
      positions.push_back(nodes.bits());
    };
    return out;
  }
  void forget() { *this = {}; }
};

void expectSame(const Rows& expected, const Rows& found) {
  EXPECT_TRUE(expected.positions == found.positions);
  EXPECT_TRUE(expected.impulses == found.impulses);
  EXPECT_TRUE(expected.models == found.models);
  EXPECT_TRUE(expected.ticks == found.ticks);
  EXPECT_GE(found.positions.size(), static_cast<std::size_t>(kSteps));
}

SceneConfig sceneNamed(const std::string& name) {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/" + name + ".yaml");
  resolveFiles(config);
  return config;
}

std::vector<std::string> shippedScenes() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(std::string(PALPATE_SOURCE_DIR) + "/scenes")) {
    const std::string name = entry.path().stem().string();
    if (name != "one-d") names.push_back(name);  // not a scene of the simulator
  }
  std::sort(names.begin(), names.end());
  return names;
}

void expectToGoOnToTheBit(const SceneConfig& config) {
  const std::int64_t step = std::llround(config.visual_step / config.haptic_step);
  const std::int64_t most = std::llround(std::min(kSearch, config.duration) / config.haptic_step);

  BuiltScene scene = buildScene(config);
  Rows rows;
  const RunSink sink = rows.sink();
  LockstepRun run(scene, timingOf(config), sink);
  std::int64_t at = 0;
  while (rows.sliding == 0 && at < most) run.runUntil(at += step);
  ASSERT_GT(rows.sliding, 0) << "nothing slides in the first " << kSearch << " s";
  at += step / 2;  // between two visual steps, with a model under way
  run.runUntil(at);
  const LockstepState saved = run.state();
  const std::string bytes = toBytes(saved.world);
  rows.forget();
  run.runUntil(at + kSteps * step + step);
  const Rows expected = rows;
  const std::string end = toBytes(run.state().world);

  // back in the same run
  rows.forget();
  run.restore(saved);
  EXPECT_TRUE(toBytes(run.state().world) == bytes);
  run.runUntil(at + kSteps * step + step);
  expectSame(expected, rows);

  // in a world built anew, from bytes, with other threads
  ThreadTeam team(3);
  const ExecutorScope scope(&team);
  BuiltScene anew = buildScene(config);
  Rows other;
  const RunSink other_sink = other.sink();
  LockstepRun second(anew, timingOf(config), other_sink);
  LockstepState state = saved;
  state.world = worldStateFrom(bytes);
  second.restore(state);
  second.runUntil(at + kSteps * step + step);
  expectSame(expected, other);
  EXPECT_TRUE(toBytes(second.state().world) == end);
}

class SavedState : public ::testing::TestWithParam<std::string> {};

TEST_P(SavedState, GoesOnToTheBitInAWorldBuiltAnew) { expectToGoOnToTheBit(sceneNamed(GetParam())); }

TEST(SavedLiveState, GoesOnToTheBitInAWorldBuiltAnew) {
  for (const char* name : {"alien", "palpation"}) {
    SceneConfig config = sceneNamed(name);
    config.method = MethodName::live;
    config.jitter = 2;
    expectToGoOnToTheBit(config);
  }
}

// What no shipped scene has: attachments that move, springs among them, a soft lump glued to a loose rigid block.
constexpr const char* kAttached = R"(
palpate: 1
name: attached
duration: 3
tool:
  shape: {bar: {size: [0.03, 0.03, 0.04], cells: [2, 2, 2]}}
  pose: {position: [0, 0, 0.0505]}
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.0399], normal: [0, 0, 1]}}
      hand:
        keyframes:
          - {t: 0}
          - {t: 0.4, position: [0, 0, -0.012]}
          - {t: 1.5, position: [0.03, 0.01, -0.012], rotation: [0, 0, 10]}
          - {t: 3, position: [-0.03, 0, -0.012]}
bodies:
  - name: slab
    shape: {bar: {size: [0.06, 0.06, 0.03], cells: [3, 3, 2]}}
    start: settled
    attachments:
      bed: {region: {halfspace: {point: [0, 0, 0.0001], normal: [0, 0, -1]}}, motion: {period: 1, keyframes: [{t: 0}, {t: 0.5, position: [0, 0, 0.004]}, {t: 1}]}}
      ligament: {region: {halfspace: {point: [0.0299, 0, 0], normal: [1, 0, 0]}}, stiffness: 1.0e5, damping: 100, motion: {period: 1, keyframes: [{t: 0}, {t: 0.5, position: [0.002, 0, 0]}, {t: 1}]}}
  - name: lump
    shape: {bar: {size: [0.03, 0.03, 0.02], cells: [2, 2, 1]}}
    pose: {position: [0, 0, 0.03]}
    start: settled
    attachments:
      seam: {region: {halfspace: {point: [0, 0, 0.0001], normal: [0, 0, -1]}}, to: slab}
  - name: block
    rigid: true
    shape: {box: {size: [0.03, 0.06, 0.03]}}
    pose: {position: [0.048, 0, 0.0001]}
  - name: cap
    shape: {bar: {size: [0.02, 0.03, 0.015], cells: [2, 2, 1]}}
    pose: {position: [0.048, 0, 0.0301]}
    start: settled
    attachments:
      seam: {region: {halfspace: {point: [0, 0, 0.0001], normal: [0, 0, -1]}}, to: block}
obstacles:
  - {name: table, plane: {}}
)";

TEST(SavedAttachedState, GoesOnToTheBitInAWorldBuiltAnew) {
  for (const MethodName method : {MethodName::live, MethodName::hsl_exact}) {
    SceneConfig config = readSceneFromString(kAttached, "attached");
    config.method = method;
    expectToGoOnToTheBit(config);
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, SavedState, ::testing::ValuesIn(shippedScenes()), [](const auto& scene) {
  std::string name = scene.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

TEST(WorldState, BytesThatAreDamagedAreRefused) {
  const BuiltScene scene = buildScene(sceneNamed("cube"));
  const std::string bytes = toBytes(scene.world.state());
  EXPECT_TRUE(sameBits(worldStateFrom(bytes), scene.world.state()));
  for (std::size_t length = 0; length < bytes.size(); length += 97) {
    EXPECT_THROW(worldStateFrom(bytes.substr(0, length)), InputError);
  }
  for (std::size_t at = 0; at < bytes.size(); at += 101) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    EXPECT_THROW(worldStateFrom(damaged), InputError) << at;
  }
  EXPECT_THROW(worldStateFrom(bytes + "x"), InputError);
}

TEST(WorldState, OfAnotherSceneIsRefused) {
  BuiltScene cube = buildScene(sceneNamed("cube"));
  const BuiltScene block = buildScene(sceneNamed("block"));
  const std::string before = toBytes(cube.world.state());
  EXPECT_THROW(cube.world.restore(block.world.state()), InputError);
  EXPECT_TRUE(toBytes(cube.world.state()) == before);
}

}  // namespace
}  // namespace palpate
