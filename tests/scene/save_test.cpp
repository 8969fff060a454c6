#include "palpate/scene/save.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "palpate/scene/document.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"
#include "scene_text.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

SceneConfig read(const std::string& text) { return readSceneFromString(text, "scene.yaml"); }

/// Everything that a document says, with its order and without its spelling.
std::string treeOf(const DocumentNode& node) {
  std::string out = std::to_string(static_cast<int>(node.kind)) + "<" + node.scalar;
  for (const auto& item : node.items) out += "," + treeOf(*item);
  for (const auto& entry : node.entries) out += ";" + entry.key + "=" + treeOf(*entry.value);
  return out + ">";
}
std::string treeOf(const std::string& text) { return treeOf(*parseDocument(text, "tree")); }

TEST(SavedScene, SaysAllThatWasRead) {
  const SceneConfig config = read(kFullScene);
  EXPECT_EQ(treeOf(sceneText(config, {}, SavedFiles::as_named)), treeOf(kFullScene));
}

TEST(SavedScene, ShippedScenesAreTheSameButForWhereFilesAre) {
  int count = 0;
  for (const auto& file : fs::directory_iterator(fs::path(PALPATE_SOURCE_DIR) / "scenes")) {
    const std::string text = readDocumentText(file.path());
    if (file.path().extension() != ".yaml" || text.find("palpate: 1") == std::string::npos) continue;
    SceneConfig config = read(text);
    config.file = file.path();
    EXPECT_EQ(treeOf(sceneText(config)), treeOf(text)) << file.path();
    ++count;
  }
  EXPECT_GE(count, 10);
}

TEST(SavedScene, HoldsTextThatYamlWouldTakeForSomethingElse) {
  for (const char* text :
       {"\"a: b # c\"", "\"null\"", "\"~\"", "\"- x\"", "\" \\\"quoted\\\" \\\\ \"", "\"two\\nlines\\tand \\x01\"",
        "\"\"", "caf\xc3\xa9", "\"[1, 2]\"", "\"&a *b !c\"", "\"---\"", "\"%TAG\""}) {
    const std::string scene = replaced(kFullScene, "description: all keys", std::string("description: ") + text);
    EXPECT_EQ(treeOf(sceneText(read(scene), {}, SavedFiles::as_named)), treeOf(scene)) << text;
  }
}

TEST(SavedScene, HasWhatTheCommandLineSays) {
  SceneConfig config = read(kSmallScene);
  Overrides o;
  o.method = "vc";
  o.aim = "predicted";
  o.derivative = "full";
  o.cone = "exact";
  o.device = "prescribed";
  o.duration = 3.25;
  o.visual_dt = 0.02;
  o.latency = 2;
  o.jitter = 1;
  o.seed = 77;
  o.tetrahedra = 450;
  applyOverrides(config, o);
  const SceneConfig again = read(sceneText(config));
  EXPECT_EQ(again.method, MethodName::vc);
  EXPECT_EQ(again.aim, AimName::predicted);
  EXPECT_EQ(again.derivative, DerivativeName::full);
  EXPECT_TRUE(again.contact.settings.cone.exact);
  EXPECT_EQ(again.device.kind, DeviceName::prescribed);
  EXPECT_EQ(again.duration, 3.25);
  EXPECT_EQ(again.visual_step, 0.02);
  EXPECT_EQ(again.latency, 2);
  EXPECT_EQ(again.jitter, 1);
  EXPECT_EQ(again.seed, 77u);
  EXPECT_EQ(again.tool.tetrahedra, 450);
  // and nothing else
  EXPECT_EQ(treeOf(sceneText(again)), treeOf(sceneText(config)));
  config = read(kFullScene);
  config.tool.handle = "rod";
  config.device.kind = DeviceName::simulated;
  config.device.recording.reset();
  const SceneConfig simulated = read(sceneText(config));
  EXPECT_EQ(simulated.tool.handle, "rod");
  EXPECT_FALSE(simulated.device.recording);
}

TEST(SavedScene, HasFactorsInItsNumbers) {
  const SceneConfig was = read(kFullScene), is = read(sceneText(was, {0.5, 3.0}, SavedFiles::as_named));
  EXPECT_EQ(is.tool.material.youngs_modulus, 3.0 * was.tool.material.youngs_modulus);
  EXPECT_EQ(is.tool.material.parts[1].youngs_modulus, 3.0 * was.tool.material.parts[1].youngs_modulus);
  EXPECT_EQ(is.bodies[0].material.youngs_modulus, 6e4);  // its default is not in the file
  EXPECT_TRUE(is.bodies.back().rigid);
  EXPECT_EQ(is.contact.friction, 0.5 * 0.7);
  EXPECT_EQ(is.contact.pairs[2].value, 0.5 * 0.6);
  EXPECT_EQ(is.tool.friction, 0.5 * 0.9);
  EXPECT_EQ(is.bodies[0].friction, 0.1);
  EXPECT_FALSE(is.bodies[1].friction);
  EXPECT_EQ(is.obstacles[0].friction, 0.15);
  EXPECT_EQ(read(sceneText(read(kSmallScene), {2.0, 1.0})).contact.friction, 1.0);
  EXPECT_NE(rejection([&] { sceneText(was, {20.0, 1.0}); }).find("friction"), std::string::npos);  // above 10
}

TEST(SavedScene, NamesFilesFromEverywhere) {
  SceneConfig config = read(kFullScene);
  config.file = "/data/scenes/s.yaml";
  const SceneConfig is = read(sceneText(config));
  EXPECT_EQ(std::get<SurfaceShapeConfig>(is.bodies[1].shape).file.file, "/data/scenes/a.obj");
  EXPECT_EQ(std::get<TetrahedraFileShapeConfig>(is.bodies[5].shape).file.file, "/data/scenes/b.msh");
  EXPECT_EQ(is.device.recording->file, "/data/scenes/motion.csv");
  const std::string packaged =
      replaced(kSmallScene, "{sphere: {radius: 0.05}}", "{surface: {package: toys-data, file: models/a.obj}}");
  EXPECT_EQ(treeOf(sceneText(read(packaged))), treeOf(packaged));
  EXPECT_EQ(
      std::get<TetrahedraFileShapeConfig>(read(sceneText(config, {}, SavedFiles::as_named)).bodies[5].shape).file.file,
      "b.msh");
}

TEST(SavedScene, SaysWhyThereIsNone) {
  EXPECT_NE(rejection([] { sceneText(SceneConfig{}); }).find("cannot be saved"), std::string::npos);
  // aliases of aliases: a few lines that would be written out as more than there is memory for
  std::string bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 20; ++i) {
    const std::string alias = "*a" + std::to_string(i - 1);
    bomb += fmt::format("a{0}: &a{0} [{1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}]\n", i, alias);
  }
  SceneConfig config = read(kSmallScene);
  config.source = parseDocument(bomb, "bomb.yaml");
  EXPECT_NE(rejection([&] { sceneText(config); }).find("too large or too deep"), std::string::npos);
  std::string deep = "[&a0 [x]";
  for (int i = 1; i < 5000; ++i) deep += fmt::format(", &a{} [*a{}]", i, i - 1);
  config.source = parseDocument(deep + "]", "deep.yaml");
  EXPECT_NE(rejection([&] { sceneText(config); }).find("too large or too deep"), std::string::npos);
}

}  // namespace
}  // namespace palpate
