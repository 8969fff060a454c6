#include "palpate/session/realtime_loops.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "palpate/scene/reader.h"

namespace palpate {
namespace {

constexpr double kForever = std::numeric_limits<double>::infinity();

SceneConfig cube() { return readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/cube.yaml"); }

void waitForTicks(RealtimeLoops& loops, std::vector<TickRecord>& ticks, std::size_t count) {
  TickRecord row;
  for (int i = 0; i < 5000 && ticks.size() < count; ++i) {
    while (loops.pop(row)) ticks.push_back(row);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

TEST(RealtimeLoops, GoOnWhereTheyStood) {
  const SceneConfig config = cube();
  BuiltScene scene = buildScene(config);
  RealtimeLoops loops(scene, timingOf(config), {});
  std::vector<TickRecord> ticks;
  bool granted = false;
  std::thread([&granted] { granted = requestRealtime(80).reason.empty(); }).join();
  EXPECT_TRUE(loops.realtimeNote().empty());
  for (int round = 1; round <= 3; ++round) {
    loops.start(1.0, kForever);
    waitForTicks(loops, ticks, 80u * round);
    EXPECT_EQ(loops.realtimeNote().empty(), granted);  // known while they run
    loops.stop();
    waitForTicks(loops, ticks, 0);
    const double stood = loops.time();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_EQ(loops.time(), stood);
  }
  TickRecord row;
  while (loops.pop(row)) ticks.push_back(row);
  ASSERT_GE(ticks.size(), 240u);
  for (std::size_t k = 1; k < ticks.size(); ++k) {
    ASSERT_GT(ticks[k].time, ticks[k - 1].time);
    // a stop is no gap in simulated time: what is missing was missed by the clock, never the pause
    ASSERT_LT((ticks[k].raw - ticks[k - 1].raw).head<3>().norm(), 1.0);
  }
}

TEST(RealtimeLoops, RunAtTheSpeedAskedFor) {
  const SceneConfig config = cube();
  BuiltScene scene = buildScene(config);
  RealtimeLoops loops(scene, timingOf(config), {});
  loops.start(0.25, kForever);
  std::this_thread::sleep_for(std::chrono::milliseconds(420));
  loops.stop();
  EXPECT_LT(loops.time(), 0.25);  // 0.1 s of simulated time, however loaded the machine is
  EXPECT_GT(loops.time(), 0.02);
}

TEST(RealtimeLoops, EndByThemselves) {
  const SceneConfig config = cube();
  BuiltScene scene = buildScene(config);
  RealtimeLoops loops(scene, timingOf(config), {});
  EXPECT_TRUE(loops.ended());
  loops.start(1.0, 0.1);
  for (int i = 0; i < 5000 && !loops.ended(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_TRUE(loops.ended());
  loops.stop();
  EXPECT_LE(loops.time(), 0.1 + 1e-9);
}

class Counting : public Executor {
 public:
  explicit Counting(int threads) : threads_(threads) {}
  void run(int parts, void (*part)(void*, int), void* loop) override {
    ++loops;
    for (int i = 0; i < parts; ++i) part(loop, i);
  }
  int threads() const override { return threads_; }
  std::atomic<int> loops{0};

 private:
  int threads_;
};

// What the visual loop's helpers leave to the haptic loop: real-time priority, or a core.
TEST(RealtimeLoops, HelpersLeaveRoom) {
  bool granted = false;
  std::thread([&granted] { granted = requestRealtime(80).scheduled; }).join();
  const int cores = static_cast<int>(std::thread::hardware_concurrency());
  for (const int threads : {cores - 1, cores}) {
    BuiltScene scene = buildScene(cube());
    RealtimeLoops loops(scene, timingOf(cube()), {});
    Counting helpers(threads);
    const ExecutorScope scope(&helpers);
    std::vector<TickRecord> ticks;
    loops.start(1.0, kForever);
    waitForTicks(loops, ticks, 300);
    loops.stop();
    EXPECT_EQ(helpers.loops > 0, granted || threads < cores) << threads << " threads";
  }
}

// Steps taken one by one are the steps of a lockstep run without latency.
TEST(RealtimeLoops, SingleStepsAreARunInLockstep) {
  SceneConfig config = cube();
  config.latency = 0;
  config.duration = 30 * config.visual_step;
  BuiltScene stepped = buildScene(config);
  std::vector<VisualRecord> states;
  RealtimeLoops loops(stepped, timingOf(config),
                      [&](const World&, const VisualRecord& record) { states.push_back(record); });
  std::vector<TickRecord> single, run;
  TickRecord row;
  for (int k = 0; k < 30; ++k) {
    loops.stepOnce();
    while (loops.pop(row)) single.push_back(row);
  }
  BuiltScene whole = buildScene(config);
  RunSink sink;
  sink.tick = [&](const TickRecord& r) { run.push_back(r); };
  runLockstep(whole, timingOf(config), sink);
  ASSERT_EQ(states.size(), 30u);
  ASSERT_EQ(single.size(), run.size());
  for (std::size_t k = 0; k < run.size(); ++k) {
    ASSERT_EQ(single[k].time, run[k].time);
    ASSERT_EQ(single[k].sent, run[k].sent) << k;
  }
}

TEST(RealtimeLoops, ChangeOfMethodLeavesNoJump) {
  const SceneConfig config = cube();
  BuiltScene scene = buildScene(config);
  RealtimeLoops loops(scene, timingOf(config), {});
  TickRecord row;
  Vec6 last = Vec6::Zero();
  bool first = true;
  const double slew = scene.haptic.safety.max_slew * config.haptic_step;
  for (int k = 0; k < 60; ++k) {
    RunTiming timing = timingOf(config);
    timing.visual_step = k % 4 < 2 ? 0.033 : 0.01;
    loops.change(k % 2 ? Rendering::virtual_coupling : Rendering::linearized, timing);
    loops.stepOnce();
    while (loops.pop(row)) {
      if (!first) {
        ASSERT_LE((row.sent - last).head<3>().norm(), slew * (1 + 1e-9));
      }
      last = row.sent;
      first = false;
    }
  }
}

}  // namespace
}  // namespace palpate
