#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "palpate/cases/case_report.h"
#include "palpate/cases/case_run.h"
#include "palpate/cases/files.h"
#include "palpate/cases/plan.h"
#include "palpate/common/error.h"
#include "palpate/record/json_file.h"
#include "palpate/scene/reader.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Gone at the end of the test.
class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("palpate-cases-" + std::to_string(::getpid()))) {
    fs::remove_all(path_);
    fs::create_directory(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

const std::string kScene = R"(palpate: 1
name: ball
tool:
  shape: {surface: {file: ball.obj}}
  handles: {top: {region: {sphere: {center: [0, 0, 0], radius: 1}}}}
bodies:
  - {name: cushion, shape: {box: {size: [1, 1, 1]}}}
)";

const std::string kStudy = R"(palpate_study: 1
name: s
kind: run
scenes: [ball.yaml]
materials:
  - {name: soft, youngs_modulus: 1.0e4}
  - {name: light, of: cushion, density: 100}
vary: {tool.friction: [0.1, 0.2], gravity: [[0, 0, 0], [0, 0, -1]]}
methods: [vc, hsl]
hands: [500/8, none]
seeds: {first: 7, count: 3}
)";

class Planned : public ::testing::Test {
 protected:
  void SetUp() override {
    writeWhole(folder_.path() / "ball.yaml", kScene);
    writeWhole(folder_.path() / "ball.obj", "v 0 0 0\n");
    writeWhole(folder_.path() / "study.yaml", kStudy);
  }
  Folder folder_;
};

TEST_F(Planned, EveryCombinationOnceTheLastFastest) {
  std::vector<std::pair<fs::path, std::string>> placed;
  const auto cases = planCases(readStudy(folder_.path() / "study.yaml"), placed);
  ASSERT_EQ(cases.size(), 2u * 2 * 2 * 2 * 2 * 3);
  EXPECT_EQ(
      cases[0].axes.dump(),
      R"({"scene":"ball","material":"soft","tool.friction":0.1,"gravity":[0,0,0],"method":"vc","hand":"500/8","seed":7})");
  EXPECT_EQ(cases[1].axes["seed"], 8);
  EXPECT_EQ(cases[3].axes["hand"], "none");
  EXPECT_EQ(cases.back().axes["material"], "light");
  EXPECT_EQ(cases.back().number, 96);
  const SceneConfig first = readSceneFromString(cases[0].scene, "first");
  EXPECT_EQ(first.tool.material.youngs_modulus, 1e4);
  EXPECT_EQ(first.gravity, Vec3::Zero());
  EXPECT_EQ(first.method, MethodName::vc);
  const SceneConfig last = readSceneFromString(cases.back().scene, "last");
  EXPECT_EQ(last.bodies[0].material.density, 100.0);
  EXPECT_EQ(last.tool.friction, 0.2);
  EXPECT_EQ(last.device.hand_stiffness, 0.0);
  EXPECT_EQ(last.seed, 9u);
  ASSERT_EQ(placed.size(), 1u);  // the surface, once for all
  EXPECT_EQ(std::get<SurfaceShapeConfig>(last.tool.shape).file.file, "../../" + placed[0].second);
}

TEST_F(Planned, IsWhole) {
  const fs::path out = folder_.path() / "out";
  ASSERT_EQ(writePlan(readStudy(folder_.path() / "study.yaml"), out), 96);
  const StudyPlan plan = readPlan(out);
  EXPECT_EQ(plan.cases(), 96);
  fs::remove(folder_.path() / "ball.obj");  // nobody needs what it was planned from
  EXPECT_NO_THROW(readScene(caseFolder(out, 96) / "scene.yaml"));
  const auto before = fs::last_write_time(out / "study.json");
  EXPECT_THROW(writePlan(readStudy(folder_.path() / "study.yaml"), out), InputError);
  EXPECT_EQ(fs::last_write_time(out / "study.json"), before);
  EXPECT_EQ(caseState(out, 3).kind, CaseState::Kind::missing);
}

TEST(Times, AreTakenOutOfASummary) {
  Json summary =
      Json::parse(R"({"scene":"a","visual":{"steps":3,"median_ms":1,"overruns":2},"haptic":{"tick_us":{"p50":1}},
                                 "linearization":{"median_ms":4},"empty":{},"rows":[{"a_ms":1}],"step_ms":{"max":1}})");
  const Json times = takeTimes(summary);
  EXPECT_EQ(summary.dump(), R"({"scene":"a","visual":{"steps":3},"empty":{},"rows":[{"a_ms":1}]})");
  EXPECT_EQ(times.dump(), R"({"visual":{"median_ms":1,"overruns":2},"haptic":{"tick_us":{"p50":1}},)"
                          R"("linearization":{"median_ms":4},"step_ms":{"max":1}})");
}

TEST(Numbers, RunsOfThreeAreJoined) {
  EXPECT_EQ(numbersText({}), "");
  EXPECT_EQ(numbersText({4}), "4");
  EXPECT_EQ(numbersText({1, 2, 4, 5, 6, 9}), "1, 2, 4 to 6, 9");
}

}  // namespace
}  // namespace palpate
