#include "palpate/session/snapshots.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "palpate/scene/reader.h"
#include "palpate/session/builder.h"
#include "palpate/session/lockstep.h"

namespace palpate {
namespace {

SceneConfig blockScene() {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/block.yaml");
  config.duration = 0.5;
  return config;
}

struct Forces {
  std::vector<Vec6> sent;
  int steps = 0;
};

RunSink sinkInto(Forces& forces) {
  RunSink sink;
  sink.tick = [&forces](const TickRecord& r) { forces.sent.push_back(r.sent); };
  sink.visual = [&forces](const VisualRecord&) { ++forces.steps; };
  return sink;
}

TEST(Snapshots, AreTakenEvenlyAndLeaveTheRunAsItIs) {
  const SceneConfig config = blockScene();
  Forces plain, watched;
  BuiltScene first = buildScene(config);
  runLockstep(first, timingOf(config), sinkInto(plain));
  BuiltScene scene = buildScene(config);
  Snapshots snapshots(config, scene.world, 2);
  runLockstep(scene, timingOf(config), snapshots.watch(sinkInto(watched)));
  EXPECT_EQ(plain.sent, watched.sent);
  EXPECT_EQ(plain.steps, watched.steps);
  const RunPictures pictures = snapshots.draw();
  ASSERT_EQ(pictures.images.size(), 2U);
  EXPECT_EQ(pictures.images[0].title.substr(0, 3), "0.1");  // due at 0.125 and 0.375, steps of 0.02
  EXPECT_EQ(pictures.images[1].title.substr(0, 3), "0.4");
  EXPECT_FALSE(pictures.images[0].alt.empty());
  EXPECT_NE(pictures.images[0].png, pictures.images[1].png);
  EXPECT_FALSE(pictures.sheet.empty());
  EXPECT_EQ(snapshots.draw().images[1].png, pictures.images[1].png);
}

TEST(Snapshots, NoneAreNone) {
  const SceneConfig config = blockScene();
  BuiltScene scene = buildScene(config);
  Forces forces;
  Snapshots snapshots(config, scene.world, 0);
  runLockstep(scene, timingOf(config), snapshots.watch(sinkInto(forces)));
  const RunPictures pictures = snapshots.draw();
  EXPECT_TRUE(pictures.images.empty());
  EXPECT_TRUE(pictures.sheet.empty());
}

TEST(Snapshots, ObstaclesOfEveryKindAreDrawn) {
  const SceneConfig config = blockScene();
  std::vector<std::vector<unsigned char>> drawn;
  for (int kind = 0; kind < 5; ++kind) {
    BuiltScene scene = buildScene(config);
    const Vec3 beside(0.07, 0, 0.03);
    Obstacle obstacle;
    if (kind == 1) obstacle.shape = BoxShape{{beside, Quat::Identity()}, Vec3::Constant(0.02)};
    if (kind == 2) obstacle.shape = SphereShape{beside, 0.02};
    if (kind == 3) obstacle.shape = CapsuleShape{beside, beside + Vec3(0, 0.05, 0), 0.02};
    if (kind == 4) obstacle.shape = PlaneShape{Vec3(0, 0.09, 0), Vec3(0, -1, 0)};
    if (kind > 0) scene.world.obstacles.push_back(obstacle);
    Snapshots snapshots(config, scene.world, 1);
    Forces forces;
    const RunSink sink = snapshots.watch(sinkInto(forces));
    VisualRecord record;
    record.time = 0.4;
    sink.visual(record);
    drawn.push_back(snapshots.draw().images.at(0).png);
    for (int other = 0; other < kind; ++other) EXPECT_NE(drawn[kind], drawn[other]) << kind << ' ' << other;
  }
}

}  // namespace
}  // namespace palpate
