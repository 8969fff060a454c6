#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

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

const std::string surface_scene = replaced(small_scene, "{sphere: {radius: 0.05}}", "{surface: {file: meshes/a.obj}}");
const std::string package_scene =
    replaced(small_scene, "{sphere: {radius: 0.05}}", "{surface: {package: toys-data, file: models/a.obj}}");

TEST_F(SceneFiles, FindsSurfacesBesideTheScene) {
  const fs::path mesh = write("meshes/a.obj", "");
  const SceneConfig scene = readScene(write("s.yaml", surface_scene));
  EXPECT_TRUE(fs::equivalent(std::get<SurfaceShapeConfig>(scene.tool.shape).file.path, mesh));
}

TEST_F(SceneFiles, FindsAbsoluteFiles) {
  const fs::path mesh = write("elsewhere/a.obj", "");
  const SceneConfig scene = readScene(write("s.yaml", replaced(surface_scene, "meshes/a.obj", mesh.string())));
  EXPECT_EQ(std::get<SurfaceShapeConfig>(scene.tool.shape).file.path, mesh);
}

TEST_F(SceneFiles, NamesAMissingSurface) {
  const fs::path file = write("s.yaml", surface_scene);
  EXPECT_EQ(rejection([&] { readScene(file); }),
            file.string() + ": tool.shape.surface.file: no such file \"" + (folder_ / "meshes/a.obj").string() + "\"");
}

TEST_F(SceneFiles, NamesAMissingRecording) {
  const fs::path file = write("s.yaml", small_scene + "device: {type: recorded, file: m.csv}\n");
  EXPECT_NE(rejection([&] { readScene(file); }).find(": device.file: no such file"), std::string::npos);
}

TEST_F(SceneFiles, SearchesPackagesWithAndWithoutTheirSuffix) {
  for (const char* place : {"one/toys-data/models/a.obj", "two/toys/models/a.obj"}) {
    const fs::path mesh = write(place, "");
    SceneConfig scene = readSceneFromString(package_scene, "s.yaml");
    resolveFiles(scene, {folder_ / "one", folder_ / "two"});
    EXPECT_EQ(std::get<SurfaceShapeConfig>(scene.tool.shape).file.path, mesh);
    fs::remove(mesh);
  }
}

TEST_F(SceneFiles, NamesTheMissingPackage) {
  SceneConfig scene = readSceneFromString(package_scene, "s.yaml");
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
    names.insert(name);
  }
  for (const char* expected : {"alien", "bunny", "block", "block-2592", "block-10140"})
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

}  // namespace
}  // namespace palpate
