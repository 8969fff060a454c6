#include "palpate/one_d/config.h"

#include <gtest/gtest.h>

#include <string>

#include "palpate/common/error.h"

namespace palpate::one_d {
namespace {

/// The message for a bad configuration; it must be one line that begins with the file's name.
std::string failure(const std::string& text) {
  try {
    parseConfig(text, "f.yaml");
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    EXPECT_EQ(message.rfind("f.yaml: ", 0), 0u) << message;
    return message;
  }
  ADD_FAILURE() << "accepted: " << text;
  return "";
}

void expectFailure(const std::string& text, const std::string& key, const std::string& cause) {
  const std::string message = failure(text);
  const std::string place = "f.yaml: " + key;
  EXPECT_EQ(message.rfind(place, 0), 0u) << message;
  EXPECT_TRUE(message.find(": ", place.size()) == place.size() || message.find(" (line ") == place.size()) << message;
  EXPECT_NE(message.find(cause), std::string::npos) << message;
}

TEST(OneDConfig, TheSceneSpellsOutTheDefaults) {
  const Config scene = readConfig(PALPATE_SOURCE_DIR "/scenes/one-d.yaml");
  const Config defaults;
  EXPECT_EQ(scene.parameters.handle_mass, defaults.parameters.handle_mass);
  EXPECT_EQ(scene.parameters.tool_mass, defaults.parameters.tool_mass);
  EXPECT_EQ(scene.parameters.spring_stiffness, defaults.parameters.spring_stiffness);
  EXPECT_EQ(scene.parameters.spring_damping, defaults.parameters.spring_damping);
  EXPECT_EQ(scene.parameters.rest_length, defaults.parameters.rest_length);
  EXPECT_EQ(scene.parameters.link_stiffness, defaults.parameters.link_stiffness);
  EXPECT_EQ(scene.parameters.link_damping, defaults.parameters.link_damping);
  EXPECT_EQ(scene.haptic_dt, defaults.haptic_dt);
  EXPECT_EQ(scene.visual_dts, defaults.visual_dts);
  EXPECT_EQ(scene.latency, defaults.latency);
  EXPECT_EQ(scene.methods, defaults.methods);
  ASSERT_EQ(scene.trajectory.size(), defaults.trajectory.size());
  for (std::size_t i = 0; i < scene.trajectory.size(); ++i) {
    EXPECT_EQ(scene.trajectory[i].t, defaults.trajectory[i].t);
    EXPECT_EQ(scene.trajectory[i].x, defaults.trajectory[i].x);
  }
}

TEST(OneDConfig, LeftOutKeysKeepTheirDefaults) {
  const Config config = parseConfig("tool_mass: +2e-2\nmethods: [hsl]\nlatency: 0\n", "f.yaml");
  EXPECT_EQ(config.parameters.tool_mass, 0.02);
  EXPECT_EQ(config.latency, 0.0);
  EXPECT_EQ(config.methods, std::vector<Method>{Method::kHsl});
  EXPECT_EQ(config.parameters.handle_mass, 0.05);
}

TEST(OneDConfig, UnknownKeysNameTheNearestOne) {
  expectFailure("spring_stifness: 3", "line 1", R"("spring_stifness"; the nearest known key is "spring_stiffness")");
  expectFailure("latency: 1\nvisual_dt: [0.01]", "line 2", R"("visual_dt"; the nearest known key is "visual_dts")");
}

TEST(OneDConfig, WrongTypesAreErrors) {
  expectFailure("tool_mass: heavy", "tool_mass", "heavy");
  expectFailure("tool_mass: 0.05 kg", "tool_mass", "0.05 kg");
  expectFailure("tool_mass:", "tool_mass", "a number");
  expectFailure("tool_mass: [1]", "tool_mass", "a number");
  expectFailure("visual_dts: 0.01", "visual_dts", "must be a list");
  expectFailure("trajectory: [[0, 0.4], [1]]", "trajectory[1]", "pair");
  expectFailure("methods: [vc, hls]", "methods[1]", "hls");
  expectFailure("methods: vc", "methods", "must be a list");
  expectFailure("tool_mass: 1\ntool_mass: 2", "line 2", "twice");
}

TEST(OneDConfig, ValuesOutOfRangeAreErrors) {
  expectFailure("handle_mass: -1", "handle_mass", "-1");
  expectFailure("handle_mass: 0", "handle_mass", "0 is out of range");
  expectFailure("tool_mass: nan", "tool_mass", "finite");
  expectFailure("tool_mass: .nan", "tool_mass", "finite");
  expectFailure("spring_stiffness: inf", "spring_stiffness", "finite");
  expectFailure("link_damping: -0.1", "link_damping", "-0.1");
  expectFailure("rest_length: -0.1", "rest_length", "-0.1");
  expectFailure("haptic_dt: 0", "haptic_dt", "0 is out of range");
  expectFailure("latency: -1", "latency", "-1");
  expectFailure("methods: []", "methods", "at least one");
  expectFailure("methods: [vc, vc]", "methods[1]", "twice");
  expectFailure("visual_dts: []", "visual_dts", "at least one");
  expectFailure("visual_dts: [0.01, 0.010]", "visual_dts[1]", "twice");
}

TEST(OneDConfig, StepsMustBeWholeMultiples) {
  expectFailure("visual_dts: [0.01, 0.0105]", "visual_dts[1]", "whole multiple");
  expectFailure("haptic_dt: 0.0003", "haptic_dt", "whole multiple");
  expectFailure("haptic_dt: 0.002\nvisual_dts: [0.02]", "haptic_dt", "whole multiple");
  EXPECT_EQ(parseConfig("haptic_dt: 0.0005\nvisual_dts: [0.0335]", "f.yaml").visual_dts[0], 0.0335);
  EXPECT_EQ(wholeMultiple(0.033, 0.001), 33);
  EXPECT_EQ(wholeMultiple(0.3, 0.1), 3);
  EXPECT_EQ(wholeMultiple(0.0333, 0.001), 0);
  EXPECT_EQ(wholeMultiple(0.0001, 0.001), 0);
}

TEST(OneDConfig, TrajectoriesMustBeUsable) {
  expectFailure("trajectory: []", "trajectory", "two points");
  expectFailure("trajectory: [[0, 0.4]]", "trajectory", "two points");
  expectFailure("trajectory: [[0.1, 0.4], [1, 0.4]]", "trajectory[0]", "must be 0");
  expectFailure("trajectory: [[0, 0.4], [1, 0.4], [1, 0.3]]", "trajectory[2]", "later");
  expectFailure("trajectory: [[0, 0.4], [1, nan]]", "trajectory[1][1]", "finite");
  expectFailure("trajectory: [[0, 0.05], [1, 0.4]]", "trajectory", "inside the wall");
  expectFailure("trajectory: [[0, 0.4], [90000, 0.4]]", "trajectory", "too long");
}

TEST(OneDConfig, MalformedFilesAreErrors) {
  EXPECT_NE(failure("tool_mass: [1, 2").find("not valid YAML"), std::string::npos);
  EXPECT_NE(failure("tool_mass: 1\n\t bad: 2").find("line 2"), std::string::npos);
  EXPECT_NE(failure("- 1\n- 2").find("must be a map"), std::string::npos);
  EXPECT_NE(failure("just text").find("must be a map"), std::string::npos);
  EXPECT_NE(failure("tool_mass: 1\n---\ntool_mass: 2").find("more than one"), std::string::npos);
  EXPECT_NE(failure("? [a, b]\n: 1").find("plain text"), std::string::npos);
  EXPECT_NE(failure("tool_mass: &a [*a]").find("f.yaml"), std::string::npos);
  failure("");
  failure("# nothing but this\n");
  failure(std::string(5000, '['));
  failure(std::string("\0\x01\xff\xfe", 4));
}

TEST(OneDConfig, MissingFilesAreErrors) {
  for (const std::string file : {"/nonexistent/one-d.yaml", "/"}) {
    try {
      readConfig(file);
      ADD_FAILURE() << file;
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).rfind(file + ": ", 0), 0u) << error.what();
    }
  }
}

}  // namespace
}  // namespace palpate::one_d
