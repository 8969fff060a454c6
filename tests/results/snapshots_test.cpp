#include "palpate/results/snapshots.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "palpate/scene/builder.h"
#include "palpate/scene/reader.h"
#include "palpate/session/lockstep.h"
#include "shared/png_pixels.h"

namespace palpate {
namespace {

SceneConfig blockScene() {
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/block.yaml");
  config.duration = 0.5;
  return config;
}

/// Box with the given center and half extents.
Surface makeBoxSurface(const Vec3& center, const Vec3& half) {
  Surface box;
  for (int i = 0; i < 8; ++i) {
    box.vertices.emplace_back(center + half.cwiseProduct(Vec3((i & 1) * 2 - 1, (i & 2) - 1, (i >> 2) * 2 - 1)));
  }
  box.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                   {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return box;
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

std::vector<unsigned char> pictureOf(const SceneConfig& config, BuiltScene& scene) {
  Snapshots snapshots(config, scene.world, 1);
  Forces forces;
  VisualRecord record;
  record.time = 0.4;
  snapshots.watch(sinkInto(forces)).visual(record);
  return snapshots.draw().images.at(0).png;
}

/// How many pixels look like the block's body (green), its held part (red), or the background.
struct Seen {
  int body = 0, held = 0, background = 0;
};
Seen look(const Bitmap& picture) {
  Seen seen;
  for (std::size_t i = 0; i + 2 < picture.rgb.size(); i += 3) {
    const int r = picture.rgb[i], g = picture.rgb[i + 1], b = picture.rgb[i + 2];
    seen.body += g > r + 15 && g > b + 30;
    seen.held += r > g + 50 && r > b + 50;
    seen.background += r > 225 && g > 225 && b > 225;
  }
  return seen;
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
  const Bitmap one = testing::decodePng(pictures.images[0].png), sheet = testing::decodePng(pictures.sheet);
  EXPECT_EQ(one.height, 480);
  EXPECT_GE(one.width, 0.7 * 480);
  EXPECT_LE(one.width, 1.6 * 480);
  EXPECT_EQ(sheet.height, one.height);
  EXPECT_EQ(sheet.width, 2 * one.width + 10);
  EXPECT_EQ(snapshots.draw().images[1].png, pictures.images[1].png);
}

TEST(Snapshots, ShowTheBodyItsHeldPartAndTheBackgroundWhereTheyAre) {
  const SceneConfig config = blockScene();
  BuiltScene scene = buildScene(config);
  const Bitmap picture = testing::decodePng(pictureOf(config, scene));
  const int pixels = picture.width * picture.height;
  const Seen seen = look(picture);
  // The camera fits block, pen and arrow into the picture with a margin: each has a part of it, none all.
  EXPECT_GT(seen.body, pixels / 50);
  EXPECT_GT(seen.held, pixels / 50);
  EXPECT_GT(seen.background, pixels / 5);
  // Held by its top layer: red is above green. All four corners lie in the margin.
  const auto middleRow = [&](bool held) {
    double sum = 0, count = 0;
    for (int y = 0; y < picture.height; ++y) {
      const auto row = picture.rgb.begin() + 3 * y * picture.width;
      const Seen part = look({picture.width, 1, {row, row + 3 * picture.width}});
      sum += y * (held ? part.held : part.body);
      count += held ? part.held : part.body;
    }
    return sum / count;
  };
  EXPECT_LT(middleRow(true), middleRow(false));
  for (const int x : {0, picture.width - 1}) {
    for (const int y : {0, picture.height - 1}) {
      const auto corner = picture.rgb.begin() + 3 * (y * picture.width + x);
      const Seen part = look({1, 1, {corner, corner + 3}});
      EXPECT_EQ(part.body + part.held, 0) << x << ' ' << y;
    }
  }
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
  for (int kind = 0; kind < 6; ++kind) {
    BuiltScene scene = buildScene(config);
    const Vec3 beside(0.07, 0, 0.03);
    Obstacle obstacle;
    if (kind == 1) obstacle.shape = BoxShape{{beside, Quat::Identity()}, Vec3::Constant(0.02)};
    if (kind == 2) obstacle.shape = SphereShape{beside, 0.02};
    if (kind == 3) obstacle.shape = CapsuleShape{beside, beside + Vec3(0, 0.05, 0), 0.02};
    if (kind == 4) obstacle.shape = PlaneShape{Vec3(0, 0.09, 0), Vec3(0, -1, 0)};
    if (kind == 5) obstacle.shape = MeshShape{makeBoxSurface(beside, Vec3::Constant(0.02))};
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

TEST(Snapshots, MeshAroundTheToolIsCutOpen) {
  const SceneConfig config = blockScene();
  const auto toolPixels = [&](bool box, bool mesh) {
    BuiltScene scene = buildScene(config);
    Eigen::AlignedBox3d tool;
    const VecX& x = scene.world.tool().state.positions;
    for (Eigen::Index i = 0; i < x.size(); i += 3) tool.extend(Vec3(x.segment<3>(i)));
    const Vec3 half = 0.6 * tool.sizes();
    Obstacle around;
    if (mesh) {
      around.shape = MeshShape{makeBoxSurface(tool.center(), half)};
    } else {
      around.shape = BoxShape{{tool.center(), Quat::Identity()}, half};
    }
    if (box) scene.world.obstacles.push_back(around);
    const Seen seen = look(testing::decodePng(pictureOf(config, scene)));
    return seen.body + seen.held;
  };
  // A whole box hides the tool. Cut open towards the camera it shows the tool but for what the back half's floor and
  // sides hide, a fifth wider than the tool: more than a quarter of what is seen without a box.
  const int bare = toolPixels(false, false);
  EXPECT_EQ(toolPixels(true, false), 0);
  EXPECT_GT(toolPixels(true, true), bare / 4);
}

TEST(Snapshots, RigidBodiesAreDrawnWhereTheyAre) {
  const SceneConfig config = blockScene();
  std::vector<std::vector<unsigned char>> drawn;
  for (const double x : {0.0, 0.2, 0.3}) {
    BuiltScene scene = buildScene(config);
    if (x > 0.0) scene.world.add(BodyModel::rigid("stone", makeBoxSurface({x, 0, 0.05}, Vec3::Constant(0.03)), 1000.0));
    drawn.push_back(pictureOf(config, scene));
  }
  EXPECT_NE(drawn[0], drawn[1]);
  EXPECT_NE(drawn[1], drawn[2]);
}

}  // namespace
}  // namespace palpate
