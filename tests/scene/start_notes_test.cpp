#include <gtest/gtest.h>

#include <string>

#include "palpate/scene/builder.h"
#include "palpate/scene/reader.h"

namespace palpate {
namespace {

std::string notesOf(const std::string& tool, const std::string& rest = "obstacles: [{name: ground, plane: {}}]\n") {
  const SceneConfig config = readSceneFromString("palpate: 1\nname: starts\ntool: {" + tool + "}\n" + rest, "starts");
  BuiltScene scene = buildScene(config);
  noteStart(config, scene);
  std::string out;
  for (const std::string& note : scene.notes) out += note + "\n";
  return out;
}

const std::string kRigid = "rigid: true, shape: {box: {size: [0.08, 0.04, 0.02]}}, handles: {grip: {}}, ";
const std::string kSoft =
    "shape: {bar: {size: [0.04, 0.04, 0.04], cells: [2, 2, 2]}}, material: {youngs_modulus: 1.0e5, poisson_ratio: "
    "0.3}, ";
const std::string kTop = "handles: {top: {region: {halfspace: {point: [0, 0, 0.035], normal: [0, 0, 1]}}}}, ";

TEST(StartNotes, AreNoneWhereAllIsAsItShouldBe) {
  EXPECT_EQ(notesOf(kRigid + "pose: {position: [0, 0, 0.05]}"), "");
  EXPECT_EQ(notesOf(kSoft + kTop + "pose: {position: [0, 0, 0.001]}"), "");
  EXPECT_EQ(notesOf(kRigid + "pose: {position: [0, 0, 0.2]}",
                    "bodies:\n  - {name: lower, rigid: true, shape: {box: {size: [0.1, 0.1, 0.1]}}}\n"
                    "  - {name: upper, rigid: true, shape: {box: {size: [0.05, 0.05, 0.05]}}, pose: {position: [0, 0, "
                    "0.1]}}\n"),
            "");
}

TEST(StartNotes, SayWhatLiesInsideSomething) {
  EXPECT_EQ(notesOf(kRigid + "start: rest, pose: {position: [0, 0, -0.013]}"),
            "tool starts 13 mm inside ground: contact will push it out\n");
  EXPECT_NE(notesOf(kRigid + "pose: {position: [0, 0, -0.013]}").find("away from the hand that holds it"),
            std::string::npos);
  EXPECT_EQ(notesOf(kRigid + "pose: {position: [0, 0, 0.2]}",
                    "bodies:\n  - {name: ball, rigid: true, shape: {sphere: {radius: 0.02}}}\n"
                    "obstacles: [{name: bar, box: {center: [0.003, 0, -0.05], half_extents: [0.1, 0.1, 0.06]}}]\n"),
            "ball starts 10 mm inside bar: contact will push it out\n");
}

TEST(StartNotes, SayWhatIsLargeOrHinges) {
  EXPECT_EQ(notesOf("rigid: true, shape: {box: {size: [8, 4, 2]}}, handles: {grip: {}}, pose: {position: [0, 0, 5]}"),
            "tool is 8 x 4 x 2 m large: a file without `size` is in meters\n");
  EXPECT_NE(notesOf(kSoft + "handles: {tip: {region: {sphere: {center: [0.02, 0.02, 0.04], radius: 0.005}}}}, "
                            "pose: {position: [0, 0, 0.01]}")
                .find("handle tip holds 1 of the tool's nodes"),
            std::string::npos);
}

}  // namespace
}  // namespace palpate
