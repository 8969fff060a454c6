#include "palpate/scene/overrides.h"

#include <limits>

#include "palpate/scene/reader.h"
#include "scene_text.h"

namespace palpate {
namespace {

SceneConfig fullScene() { return readSceneFromString(kFullScene, "s.yaml"); }

std::string rejectedOverride(const Overrides& overrides) {
  SceneConfig scene = fullScene();
  return rejection([&] { applyOverrides(scene, overrides); });
}

TEST(Overrides, ChangeWhatTheyName) {
  SceneConfig scene = fullScene();
  Overrides overrides;
  overrides.method = "vc";
  overrides.aim = "sample";
  overrides.derivative = "frozen";
  overrides.cone = "polyhedral";
  overrides.handle = "rod";
  overrides.device = "prescribed";
  overrides.duration = 1.5;
  overrides.visual_dt = 0.01;
  overrides.latency = 0;
  overrides.jitter = 3;
  overrides.seed = 9;
  overrides.tetrahedra = 3000;
  applyOverrides(scene, overrides);
  EXPECT_EQ(scene.method, MethodName::vc);
  EXPECT_EQ(scene.aim, AimName::sample);
  EXPECT_EQ(scene.derivative, DerivativeName::frozen);
  EXPECT_FALSE(scene.contact.settings.cone.exact);
  EXPECT_EQ(scene.tool.chosenHandle().name, "rod");
  EXPECT_EQ(scene.device.kind, DeviceName::prescribed);
  EXPECT_FALSE(scene.device.recording.has_value());
  EXPECT_EQ(scene.duration, 1.5);
  EXPECT_EQ(scene.ticksPerStep(), 5);
  EXPECT_EQ(scene.latency, 0);
  EXPECT_EQ(scene.jitter, 3);
  EXPECT_EQ(scene.seed, 9U);
  EXPECT_EQ(scene.tool.tetrahedra, 3000);
}

TEST(Overrides, NoneChangeNothing) {
  SceneConfig scene = fullScene();
  applyOverrides(scene, {});
  EXPECT_EQ(scene.method, MethodName::hsl_exact);
  EXPECT_EQ(scene.tool.handle, "grip");
  EXPECT_EQ(scene.device.kind, DeviceName::recorded);
  EXPECT_EQ(scene.latency, 2);
}

TEST(Overrides, NamesAreTheOnesThatScenesUse) {
  EXPECT_STREQ(toString(MethodName::hsl_exact), "hsl-exact");
  EXPECT_STREQ(toString(AimName::predicted), "predicted");
  EXPECT_STREQ(toString(DerivativeName::full), "full");
  EXPECT_STREQ(toString(DeviceName::recorded), "recorded");
}

TEST(Overrides, RejectBadValuesByOption) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(rejectedOverride({.duration = nan}),
            "--duration: nan is not a finite number; it must be above 0 and at most 3600 s");
  EXPECT_EQ(rejectedOverride({.duration = 0.0}),
            "--duration: 0 is out of range; it must be above 0 and at most 3600 s");
  EXPECT_EQ(rejectedOverride({.duration = std::numeric_limits<double>::infinity()}),
            "--duration: inf is not a finite number; it must be above 0 and at most 3600 s");
  EXPECT_EQ(rejectedOverride({.visual_dt = nan}),
            "--visual-dt: nan is not a finite number; it must be above 0 and at most 1 s");
  EXPECT_EQ(rejectedOverride({.visual_dt = 0.0}), "--visual-dt: 0 is out of range; it must be above 0 and at most 1 s");
  EXPECT_EQ(rejectedOverride({.visual_dt = 0.011}),
            "--visual-dt: 0.011 s is not a whole multiple of the haptic step, 0.002 s");
  EXPECT_EQ(rejectedOverride({.method = "hsl2"}), "--method: \"hsl2\" is not one of live, hsl, hsl-exact, vc");
  EXPECT_EQ(rejectedOverride({.aim = ""}), "--aim: \"\" is not one of sample, predicted");
  EXPECT_EQ(rejectedOverride({.derivative = "none"}), "--derivative: \"none\" is not one of frozen, full");
  EXPECT_EQ(rejectedOverride({.cone = "round"}), "--cone: \"round\" is not one of polyhedral, exact");
  EXPECT_EQ(rejectedOverride({.handle = "grap"}), "--handle: the tool has no handle \"grap\"; the nearest is \"grip\"");
  EXPECT_EQ(rejectedOverride({.device = "omni"}),
            "--device: \"omni\" is not one of simulated, prescribed, recorded, inverse3, touch, force_dimension, "
            "spacenavigator");
  EXPECT_EQ(rejectedOverride({.device = "touch:nmae=x"}),
            "--device: unknown option \"nmae\"; the nearest known option is \"name\"");
  EXPECT_EQ(rejectedOverride({.device = "simulated:name=x"}), "--device: simulated has no options");
  EXPECT_EQ(rejectedOverride({.device = "recorded:/no/such.csv"}), "--device: no such file \"/no/such.csv\"");
  EXPECT_EQ(rejectedOverride({.latency = -1}), "--latency: -1 is out of range; it must be from 0 to 100");
  EXPECT_EQ(rejectedOverride({.latency = 1LL << 40}),
            "--latency: 1099511627776 is out of range; it must be from 0 to 100");
  EXPECT_EQ(rejectedOverride({.tetrahedra = 5}), "--tetrahedra: 5 is out of range; it must be from 10 to 200000");
  EXPECT_EQ(rejectedOverride({.tetrahedra = 200000}),
            "--tetrahedra: the scene asks for 201144 tetrahedra; at most 200000 are allowed");
}

TEST(Overrides, DeviceNeedsARecording) {
  SceneConfig scene = readSceneFromString(kSmallScene, "s.yaml");
  EXPECT_EQ(rejection([&] { applyOverrides(scene, {.device = "recorded"}); }),
            "--device: a recording is needed; write recorded:FILE");
}

TEST(Overrides, TetrahedraNeedAnEmbeddedSurface) {
  SceneConfig scene = readSceneFromString(
      replaced(kSmallScene, "{sphere: {radius: 0.05}}", "{bar: {size: [0.1, 0.1, 0.1], cells: [2, 2, 2]}}"), "s.yaml");
  EXPECT_EQ(rejection([&] { applyOverrides(scene, {.tetrahedra = 300}); }),
            "--tetrahedra: the scene's tool has tetrahedra of its own; only embedded surfaces take a count");
}

TEST(Overrides, LeaveTheSceneAloneWhenOneIsBad) {
  SceneConfig scene = fullScene();
  rejection([&] { applyOverrides(scene, {.method = "vc", .duration = -1.0}); });
  EXPECT_EQ(scene.method, MethodName::hsl_exact);
}

}  // namespace
}  // namespace palpate
