#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include "palpate/scene/document.h"
#include "palpate/scene/reader.h"
#include "scene_text.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

/// A folder that lasts as long as the test.
class SceneFiles : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ =
        fs::temp_directory_path() / (std::string("palpate-scene-") + test->name() + "-" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path write(const std::string& name, const std::string& text) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }

  fs::path folder_;
};

const std::string kSurfaceScene = replaced(kSmallScene, "{sphere: {radius: 0.05}}", "{surface: {file: meshes/a.obj}}");
const std::string kPackageScene =
    replaced(kSmallScene, "{sphere: {radius: 0.05}}", "{surface: {package: toys-data, file: models/a.obj}}");

TEST_F(SceneFiles, FindsSurfacesBesideTheScene) {
  const fs::path mesh = write("meshes/a.obj", "");
  const SceneConfig scene = readScene(write("s.yaml", kSurfaceScene));
  EXPECT_TRUE(fs::equivalent(std::get<SurfaceShapeConfig>(scene.tool.shape).file.path, mesh));
}

TEST_F(SceneFiles, FindsAbsoluteFiles) {
  const fs::path mesh = write("elsewhere/a.obj", "");
  const SceneConfig scene = readScene(write("s.yaml", replaced(kSurfaceScene, "meshes/a.obj", mesh.string())));
  EXPECT_EQ(std::get<SurfaceShapeConfig>(scene.tool.shape).file.path, mesh);
}

TEST_F(SceneFiles, NamesAMissingSurface) {
  const fs::path file = write("s.yaml", kSurfaceScene);
  EXPECT_EQ(rejection([&] { readScene(file); }),
            file.string() + ": tool.shape.surface.file: no such file \"" + (folder_ / "meshes/a.obj").string() + "\"");
}

TEST_F(SceneFiles, NamesTheSurfaceOfAnObstacle) {
  const std::string text = kSmallScene + "obstacles:\n  - {mesh: {shape: {surface: {file: rock.ply}}}}\n";
  const fs::path file = write("s.yaml", text);
  EXPECT_NE(rejection([&] { readScene(file); }).find(": obstacles[0].mesh.shape.surface.file: no such file"),
            std::string::npos);
  const fs::path mesh = write("rock.ply", "");
  const SceneConfig scene = readScene(file);
  const auto& obstacle = std::get<MeshObstacleConfig>(scene.obstacles[0].geometry);
  EXPECT_TRUE(fs::equivalent(std::get<SurfaceShapeConfig>(obstacle.shape).file.path, mesh));
}

TEST_F(SceneFiles, NamesAMissingRecording) {
  const fs::path file = write("s.yaml", kSmallScene + "device: {type: recorded, file: m.csv}\n");
  EXPECT_NE(rejection([&] { readScene(file); }).find(": device.file: no such file"), std::string::npos);
}

TEST_F(SceneFiles, SearchesPackagesWithAndWithoutTheirSuffix) {
  for (const char* place : {"one/toys-data/models/a.obj", "two/toys/models/a.obj"}) {
    const fs::path mesh = write(place, "");
    SceneConfig scene = readSceneFromString(kPackageScene, "s.yaml");
    resolveFiles(scene, {folder_ / "one", folder_ / "two"});
    EXPECT_EQ(std::get<SurfaceShapeConfig>(scene.tool.shape).file.path, mesh);
    fs::remove(mesh);
  }
}

TEST_F(SceneFiles, NamesTheMissingPackage) {
  SceneConfig scene = readSceneFromString(kPackageScene, "s.yaml");
  scene.file = "s.yaml";
  EXPECT_EQ(
      rejection([&] { resolveFiles(scene, {folder_}); }),
      "s.yaml: tool.shape.surface.file: \"models/a.obj\" is not installed; it comes with the Debian package toys-data "
      "(apt-get install toys-data)");
}

TEST_F(SceneFiles, RejectsWhatIsNoFile) {
  EXPECT_EQ(rejection([&] { readScene(folder_ / "no.yaml"); }), (folder_ / "no.yaml").string() + ": no such file");
  EXPECT_EQ(rejection([&] { readScene(folder_); }), folder_.string() + ": is not a regular file");
  EXPECT_EQ(rejection([&] { readScene("/dev/zero"); }), "/dev/zero: is not a regular file");
  const fs::path large = write("large.yaml", std::string((1 << 20) + 1, '#'));
  EXPECT_EQ(rejection([&] { readScene(large); }), large.string() + ": larger than 1048576 bytes");
}

TEST(ShippedScenes, AllRead) {
  const fs::path folder = fs::path(PALPATE_SOURCE_DIR) / "scenes";
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().stem().string();
    if (entry.path().extension() != ".yaml" || name == "one-d") continue;  // one-d has a schema of its own
    SceneConfig scene;
    ASSERT_NO_THROW({
      std::ifstream stream(entry.path());
      const std::string text((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
      scene = readSceneFromString(text, entry.path().string());
    }) << name;
    EXPECT_EQ(scene.name, name);
    EXPECT_FALSE(scene.description.empty()) << name;
    for (const HandleConfig& handle : scene.tool.handles) {
      ASSERT_FALSE(handle.hand.keyframes.empty()) << name;
      EXPECT_LE(handle.hand.keyframes.back().time, scene.duration) << name;
    }
    EXPECT_LE(scene.duration, 20.0) << name;
    names.insert(name);
  }
  for (const char* expected : {"alien", "bunny", "block", "block-2592", "block-10140", "alien-self", "bunnies",
                               "palpation", "liver", "plug", "pile"})
    EXPECT_TRUE(names.contains(expected)) << expected;
}

TEST(ShippedScenes, BlocksDifferInTheirGridOnly) {
  const fs::path folder = fs::path(PALPATE_SOURCE_DIR) / "scenes";
  const int counts[] = {288, 2592, 10140};
  int i = 0;
  for (const char* name : {"block.yaml", "block-2592.yaml", "block-10140.yaml"}) {
    const SceneConfig scene = readScene(folder / name);
    const auto& bar = std::get<BarShapeConfig>(scene.tool.shape);
    EXPECT_EQ(6 * bar.cells[0] * bar.cells[1] * bar.cells[2], counts[i++]);
    EXPECT_EQ(bar.size, Vec3(0.08, 0.08, 0.06));
    EXPECT_EQ(scene.visual_step, 0.02);
    EXPECT_EQ(scene.tool.material.youngs_modulus, 2e4);
    EXPECT_EQ(scene.tool.material.poisson_ratio, 0.4);
    EXPECT_EQ(scene.tool.material.density, 1000.0);
    EXPECT_EQ(scene.obstacles[0].friction, 0.5);
    EXPECT_EQ(scene.device.kind, DeviceName::prescribed);
  }
}

TEST(ShippedScenes, AlienHasThreeHandlesAndTwentySeconds) {
  const SceneConfig scene = readScene(fs::path(PALPATE_SOURCE_DIR) / "scenes" / "alien.yaml");
  EXPECT_EQ(scene.tool.handles.size(), 3U);
  EXPECT_EQ(scene.duration, 20.0);
}

TEST(ShippedScenes, ContactScenesHaveWhatTheyAreMeantToShow) {
  const auto scene = [](const char* name) {
    const fs::path file = fs::path(PALPATE_SOURCE_DIR) / "scenes" / (std::string(name) + ".yaml");
    return readSceneFromString(readDocumentText(file), file.string());
  };
  EXPECT_EQ(scene("pile").bodies.size(), 10U);
  const SceneConfig bunnies = scene("bunnies");
  for (const ShapeConfig& shape : {bunnies.tool.shape, bunnies.bodies.at(0).shape})
    EXPECT_EQ(std::get<SurfaceShapeConfig>(shape).file.package, "glmark2-data");
  EXPECT_TRUE(std::holds_alternative<MeshObstacleConfig>(scene("plug").obstacles.at(0).geometry));
  EXPECT_TRUE(scene("alien-self").tool.self_contact);
  EXPECT_EQ(scene("alien-self").tool.tetrahedra, 288);
}

// The finger's path leads over the inclusion.
TEST(ShippedScenes, TheFingerCrossesTheInclusion) {
  const fs::path file = fs::path(PALPATE_SOURCE_DIR) / "scenes" / "palpation.yaml";
  const SceneConfig scene = readSceneFromString(readDocumentText(file), file.string());
  const FreeBodyConfig& tissue = scene.bodies.at(0);
  const MaterialPartConfig& part = tissue.material.parts.at(1);
  const auto& inclusion = std::get<SphereRegionConfig>(part.region);
  EXPECT_GE(part.youngs_modulus, 10 * tissue.material.youngs_modulus);
  double first = 1e9, last = -1e9;
  for (const KeyframeConfig& key : scene.tool.chosenHandle().hand.keyframes) {
    const double x = scene.tool.pose.position.x() + key.position.x() - tissue.pose.position.x();
    first = std::min(first, x);
    last = std::max(last, x);
  }
  EXPECT_LT(first, inclusion.center.x() - inclusion.radius);
  EXPECT_GT(last, inclusion.center.x() + inclusion.radius);
}

}  // namespace
}  // namespace palpate
