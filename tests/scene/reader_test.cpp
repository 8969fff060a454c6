#include <fmt/format.h>

#include <numbers>

#include "palpate/scene/builder.h"
#include "palpate/scene/reader.h"
#include "scene_text.h"

namespace palpate {
namespace {

constexpr double kPi = std::numbers::pi;

SceneConfig read(const std::string& text) { return readSceneFromString(text, "s.yaml"); }

std::string rejectedText(const std::string& text) {
  return rejection([&] { read(text); });
}

/// What the reader says to the full scene with one change.
std::string rejectedChange(const std::string& from, const std::string& to) {
  return rejectedText(replaced(kFullScene, from, to));
}

void expectClose(const Vec3& actual, const Vec3& expected) {
  EXPECT_LT((actual - expected).norm(), 1e-14) << actual.transpose();
}

TEST(SceneReader, ReadsTheRun) {
  const SceneConfig scene = read(kFullScene);
  EXPECT_EQ(scene.name, "everything");
  EXPECT_EQ(scene.description, "all keys");
  expectClose(scene.gravity, {0.1, -0.2, -9.5});
  EXPECT_EQ(scene.duration, 7.0);
  EXPECT_EQ(scene.method, MethodName::hsl_exact);
  EXPECT_EQ(scene.aim, AimName::predicted);
  EXPECT_EQ(scene.derivative, DerivativeName::full);
  EXPECT_EQ(scene.latency, 2);
  EXPECT_EQ(scene.jitter, 3);
  EXPECT_EQ(scene.seed, 18446744073709551615ULL);
  EXPECT_EQ(scene.visual_step, 0.02);
  EXPECT_EQ(scene.substeps, 3);
  EXPECT_FALSE(scene.substeps_auto);
  EXPECT_EQ(scene.haptic_step, 0.002);
  EXPECT_EQ(scene.ticksPerStep(), 10);
  EXPECT_TRUE(scene.weight_compensation);
}

TEST(SceneReader, PicturesLookFromWhereTheSceneSaysOrFromTheToolsFront) {
  expectClose(read(kFullScene).viewFrom(), {0, -0.6, 0.8});
  const Vec3 alien = Vec3(0.5, 0.95, 0.42).normalized();
  expectClose(read(replaced(kFullScene, "view: {from: [0, -3, 4]}\n", "")).viewFrom(), alien);
  expectClose(read(kSmallScene).viewFrom(), {-alien.x(), -alien.y(), alien.z()});
}

TEST(SceneReader, ReadsContactLinkDeviceAndSafety) {
  const SceneConfig scene = read(kFullScene);
  EXPECT_TRUE(scene.contact.settings.cone.exact);
  EXPECT_EQ(scene.contact.settings.cone.facets, 12);
  EXPECT_EQ(scene.contact.friction, 0.7);
  EXPECT_EQ(scene.contact.thickness, 0.0006);
  EXPECT_EQ(scene.contact.settings.max_recovery_speed, 0.25);
  EXPECT_EQ(scene.contact.settings.margin, 0.004);
  EXPECT_EQ(scene.contact.settings.penetration_tolerance, 2e-5);
  EXPECT_EQ(scene.contact.settings.max_passes, 6);
  EXPECT_FALSE(scene.contact.settings.reduction);
  EXPECT_EQ(scene.contact.settings.solver.max_iterations, 500);
  EXPECT_EQ(scene.contact.settings.solver.tolerance, 1e-8);
  EXPECT_EQ(scene.link.stiffness, 600.0);
  EXPECT_EQ(scene.link.damping, 4.0);
  EXPECT_EQ(scene.link.rotational_stiffness, 0.9);
  EXPECT_EQ(scene.link.rotational_damping, 0.004);
  EXPECT_EQ(scene.link.peak_force, 7.0);
  EXPECT_EQ(scene.link.peak_torque, 0.3);
  EXPECT_EQ(scene.device.kind, DeviceName::recorded);
  EXPECT_EQ(scene.device.recording->file, "motion.csv");
  EXPECT_EQ(scene.device.mass, 0.05);
  EXPECT_EQ(scene.device.inertia, 2e-4);
  EXPECT_EQ(scene.device.damping, 0.3);
  EXPECT_EQ(scene.device.rotational_damping, 6e-4);
  EXPECT_EQ(scene.device.hand_stiffness, 400.0);
  EXPECT_EQ(scene.device.hand_damping, 7.0);
  EXPECT_EQ(scene.device.hand_rotational_stiffness, 1.5);
  EXPECT_EQ(scene.device.hand_rotational_damping, 0.02);
  EXPECT_EQ(scene.device.limits.peak_force, 8.0);
  EXPECT_EQ(scene.device.limits.continuous_force, 2.0);
  EXPECT_EQ(scene.device.limits.peak_torque, 0.2);
  EXPECT_EQ(scene.device.limits.stiffness, 900.0);
  EXPECT_EQ(scene.device.limits.damping, 6.0);
  EXPECT_EQ(scene.device.limits.rotational_stiffness, 2.0);
  EXPECT_EQ(scene.device.limits.rotational_damping, 0.006);
  EXPECT_EQ(scene.device.limits.workspace_radius, 0.2);
  EXPECT_EQ(scene.safety.settings.max_slew, 500.0);
  EXPECT_EQ(scene.safety.settings.start_ramp, 0.3);
  EXPECT_EQ(scene.safety.settings.gap_limit, 0.04);
  EXPECT_EQ(scene.safety.settings.gap_ramp, 0.7);
  EXPECT_EQ(scene.safety.model_age_limit, 0.2);
  const PresenceSettings& presence = scene.safety.settings.presence;
  EXPECT_EQ(presence.dead_man, 3);
  EXPECT_TRUE(presence.start_gate);
  EXPECT_EQ(presence.workspace, 0.15);
  EXPECT_EQ(presence.frozen_limit, 1.5);
  EXPECT_FALSE(scene.safety.settings.oscillation.enabled);
  const PassivitySettings& passivity = scene.safety.settings.passivity;
  EXPECT_TRUE(passivity.enabled);
  EXPECT_EQ(passivity.allowance, 0.02);
  EXPECT_EQ(passivity.max_damping, 1.5);
  EXPECT_EQ(passivity.max_rotational_damping, 0.004);
}

TEST(SceneReader, LinkIsWhatTheDeviceAllowsButForItsOwnKeys) {
  const SceneConfig scene = read(replaced(kFullScene, "damping: 4, ", ""));
  EXPECT_EQ(scene.link.stiffness, 600.0);
  EXPECT_EQ(scene.link.damping, 6.0);  // of the device's limits, which come later in the file
  EXPECT_EQ(scene.link.rotational_stiffness, 0.9);
}

TEST(SceneReader, ReadsTheTool) {
  const ToolConfig tool = read(kFullScene).tool;
  EXPECT_EQ(tool.name, "tool");
  EXPECT_EQ(std::get<AlienShapeConfig>(tool.shape).height, 0.3);
  EXPECT_EQ(std::get<AlienShapeConfig>(tool.shape).resolution, 0.03);
  EXPECT_EQ(tool.tetrahedra, 288);
  expectClose(tool.pose.position, {0.1, 0.2, 0.3});
  expectClose(tool.pose.rotation * Vec3::UnitX(), Vec3::UnitY());
  EXPECT_EQ(tool.material.youngs_modulus, 3e4);
  EXPECT_EQ(tool.material.poisson_ratio, 0.3);
  EXPECT_EQ(tool.material.density, 250.0);
  EXPECT_EQ(tool.material.damping_alpha, 0.5);
  EXPECT_EQ(tool.material.damping_beta, 0.001);
  EXPECT_EQ(tool.friction, 0.9);
  EXPECT_FALSE(tool.self_contact);
}

TEST(SceneReader, ReadsAttachments) {
  const std::string text = R"(  attachments:
    root: {region: {sphere: {center: [0, 0, 0], radius: 0.02}}}
    ligament: {region: {halfspace: {point: [0, 0, 0.05], normal: [0, 0, -1]}}, stiffness: 1.0e5, damping: 30, motion: {keyframes: [{t: 0}, {t: 1, position: [0, 0, 0.01]}, {t: 2}], smooth: false, period: 2.5}}
  handles:)";
  const SceneConfig scene = read(replaced(kSmallScene, "  handles:", text));
  ASSERT_EQ(scene.tool.attachments.size(), 2U);
  EXPECT_EQ(scene.tool.attachments[0].name, "root");
  EXPECT_FALSE(scene.tool.attachments[0].stiffness);
  EXPECT_EQ(scene.tool.attachments[1].stiffness, 1e5);
  EXPECT_EQ(scene.tool.attachments[1].damping, 30.0);
  EXPECT_EQ(scene.tool.attachments[1].period, 2.5);
  ASSERT_EQ(scene.tool.attachments[1].motion.keyframes.size(), 3U);
  EXPECT_EQ(scene.tool.attachments[1].motion.keyframes[1].position.z(), 0.01);
  EXPECT_FALSE(scene.tool.attachments[1].motion.smooth);
  EXPECT_TRUE(scene.tool.attachments[0].motion.keyframes.empty());
  EXPECT_EQ(scene.method, MethodName::hsl);  // live is for tools that the world does not hold
  EXPECT_EQ(read(kSmallScene).method, MethodName::live);
}

// A tool that is glued is felt with live where something holds what it is glued to, if only through others.
TEST(SceneReader, MethodOfAGluedToolGoesByWhatHoldsIt) {
  const std::string region = "region: {halfspace: {point: [0, 0, 0.02], normal: [0, 0, -1]}}";
  const auto scene = [&](const std::string& of_tool, const std::string& of_lower, const std::string& method = "") {
    const auto attached = [&](const std::string& to, const char* indent) {
      return to.empty() ? std::string()
                        : fmt::format("{}attachments: {{joint: {{{}{}}}}}\n", indent, region,
                                      to == "world" ? std::string() : ", to: " + to);
    };
    return replaced(kSmallScene, "  handles:", attached(of_tool, "  ") + "  handles:") + method +
           "bodies:\n  - {name: upper, shape: {bar: {size: [0.1, 0.1, 0.1], cells: [2, 2, 2]}}, attachments: {joint: "
           "{" +
           region + ", to: lower}}}\n  - name: lower\n    shape: {bar: {size: [0.1, 0.1, 0.1], cells: [2, 2, 2]}}\n" +
           attached(of_lower, "    ");
  };
  EXPECT_EQ(read(scene("", "")).method, MethodName::live);
  EXPECT_EQ(read(scene("upper", "world")).method, MethodName::live);
  EXPECT_EQ(read(scene("", "tool")).method, MethodName::hsl);
  EXPECT_EQ(read(scene("upper", "")).method, MethodName::hsl);
  EXPECT_EQ(read(scene("upper", "", "method: vc\n")).method, MethodName::vc);
  EXPECT_NE(rejectedText(scene("upper", "", "method: live\n")).find("nothing holds upper; take hsl"),
            std::string::npos);
}

// Springs have their stiffness per area of the surface in the region, here half a sphere's.
TEST(SceneBuilder, SpringsGoByArea) {
  const std::string text = R"(  attachments:
    root: {region: {halfspace: {point: [0, 0, 0.05], normal: [0, 0, -1]}}, stiffness: 1.0e5, damping: 200}
  handles:)";
  const BuiltScene scene = buildScene(read(replaced(kSmallScene, "  handles:", text)));
  const BodyModel& tool = scene.world.tool().model;
  const double area = 2 * std::acos(-1.0) * 0.05 * 0.05;
  EXPECT_NEAR(tool.springStiffness().sum(), 1e5 * area, 0.03 * 1e5 * area);
  EXPECT_NEAR(tool.springDamping().sum(), 2e-3 * tool.springStiffness().sum(), 1e-9);
  EXPECT_GE(tool.springStiffness().minCoeff(), 0.0);
}

TEST(SceneReader, ReadsPartsWhichTakeOverWhatTheyLeaveOut) {
  const MaterialConfig material = read(kFullScene).tool.material;
  ASSERT_EQ(material.parts.size(), 2U);
  expectClose(std::get<HalfspaceRegionConfig>(material.parts[0].region).point, {0, 0, 0.2});
  EXPECT_EQ(material.parts[0].youngs_modulus, 5e4);
  EXPECT_EQ(material.parts[0].poisson_ratio, 0.3);
  EXPECT_EQ(material.parts[0].density, 250.0);
  EXPECT_EQ(std::get<SphereRegionConfig>(material.parts[1].region).radius, 0.06);
  EXPECT_EQ(material.parts[1].youngs_modulus, 9e5);
  EXPECT_EQ(material.parts[1].poisson_ratio, 0.2);
  EXPECT_EQ(material.parts[1].density, 600.0);
  // wherever the body's own values stand
  const std::string parts_first =
      "material: {parts: [{region: {sphere: {center: [0, 0, 0], radius: 1}}, youngs_modulus: 1}], density: 77}";
  const SceneConfig scene = read(replaced(kSmallScene, "  handles:", "  " + parts_first + "\n  handles:"));
  EXPECT_EQ(scene.tool.material.parts[0].density, 77.0);
}

TEST(SceneReader, ReadsFrictionPairs) {
  const ContactConfig contact = read(kFullScene).contact;
  ASSERT_EQ(contact.pairs.size(), 3U);
  EXPECT_EQ(contact.pairs[0].first, "tool");
  EXPECT_EQ(contact.pairs[0].second, "ground");
  EXPECT_EQ(contact.pairs[0].value, 0.8);
  EXPECT_EQ(contact.pairs[1].second, "tool");
  EXPECT_EQ(contact.pairs[1].value, 0.1);
  EXPECT_EQ(contact.pairs[2].first, "stone");
}

TEST(SceneReader, ReadsAutomaticSubsteps) {
  const SceneConfig scene = read(replaced(kFullScene, "substeps: 3", "substeps: auto"));
  EXPECT_TRUE(scene.substeps_auto);
  EXPECT_EQ(scene.substeps, 1);
}

TEST(SceneReader, ReadsHandles) {
  const ToolConfig tool = read(kFullScene).tool;
  ASSERT_EQ(tool.handles.size(), 5U);
  EXPECT_EQ(tool.handle, "grip");
  EXPECT_EQ(&tool.chosenHandle(), &tool.handles[1]);
  expectClose(std::get<SphereRegionConfig>(tool.handles[0].region).center, {0.01, 0.02, 0.03});
  EXPECT_EQ(std::get<SphereRegionConfig>(tool.handles[0].region).radius, 0.04);
  EXPECT_EQ(std::get<LandmarkRegionConfig>(tool.handles[1].region).landmark, "left_hand");
  EXPECT_EQ(std::get<LandmarkRegionConfig>(tool.handles[1].region).radius, 0.05);
  expectClose(std::get<BoxRegionConfig>(tool.handles[2].region).min, {-1, -2, -3});
  expectClose(std::get<BoxRegionConfig>(tool.handles[2].region).max, {1, 2, 3});
  expectClose(std::get<CapsuleRegionConfig>(tool.handles[3].region).b, {0, 0, 1});
  EXPECT_EQ(std::get<CapsuleRegionConfig>(tool.handles[3].region).radius, 0.1);
  expectClose(std::get<HalfspaceRegionConfig>(tool.handles[4].region).point, {0, 0, 0.1});
  expectClose(std::get<HalfspaceRegionConfig>(tool.handles[4].region).normal, {0, 0, 1});
  const HandleConfig& grip = tool.handles[1];
  EXPECT_EQ(grip.mass, 0.03);
  expectClose(*grip.inertia, {1e-5, 2e-5, 2.5e-5});
  EXPECT_FALSE(tool.handles[0].inertia.has_value());
  EXPECT_FALSE(grip.hand.smooth);
  ASSERT_EQ(grip.hand.keyframes.size(), 2U);
  EXPECT_EQ(grip.hand.keyframes[1].time, 1.5);
  expectClose(grip.hand.keyframes[1].position, {0.01, 0.02, 0.03});
  expectClose(grip.hand.keyframes[1].rotation, {0, kPi, 0});
}

TEST(SceneReader, ReadsBodies) {
  const SceneConfig scene = read(kFullScene);
  ASSERT_EQ(scene.bodies.size(), 7U);
  const FreeBodyConfig& cushion = scene.bodies[0];
  EXPECT_EQ(cushion.name, "cushion");
  expectClose(std::get<BarShapeConfig>(cushion.shape).size, {0.1, 0.2, 0.3});
  EXPECT_EQ(std::get<BarShapeConfig>(cushion.shape).cells, (std::array<int, 3>{2, 3, 4}));
  expectClose(cushion.velocity, {1, 2, 3});
  expectClose(cushion.angular_velocity, {kPi, 0, 0});
  EXPECT_EQ(cushion.friction, 0.2);
  EXPECT_TRUE(cushion.settled);
  EXPECT_TRUE(scene.tool.settled);
  const auto& surface = std::get<SurfaceShapeConfig>(scene.bodies[1].shape);
  EXPECT_EQ(scene.bodies[1].name, "body-2");
  EXPECT_EQ(scene.bodies[1].tetrahedra, 100);
  EXPECT_FALSE(scene.bodies[1].settled);
  EXPECT_EQ(surface.file.file, "a.obj");
  EXPECT_EQ(surface.size, 0.2);
  EXPECT_EQ(surface.up, AxisName::y);
  expectClose(std::get<BoxShapeConfig>(scene.bodies[2].shape).size, {0.1, 0.1, 0.2});
  EXPECT_EQ(std::get<SphereShapeConfig>(scene.bodies[3].shape).radius, 0.05);
  EXPECT_EQ(std::get<CapsuleShapeConfig>(scene.bodies[4].shape).radius, 0.02);
  EXPECT_EQ(std::get<CapsuleShapeConfig>(scene.bodies[4].shape).length, 0.1);
  EXPECT_EQ(std::get<TetrahedraFileShapeConfig>(scene.bodies[5].shape).file.file, "b.msh");
  EXPECT_FALSE(cushion.rigid);
  EXPECT_TRUE(cushion.self_contact);
  const FreeBodyConfig& stone = scene.bodies[6];
  EXPECT_TRUE(stone.rigid);
  EXPECT_EQ(stone.material.density, 2600.0);
  const auto& revolution = std::get<RevolutionShapeConfig>(stone.shape);
  EXPECT_EQ(revolution.segments, 24);
  EXPECT_EQ(revolution.profile, (RevolutionProfile{{0, 0}, {0.01, 0}, {0.02, 0.03}, {0, 0.03}}));
}

TEST(SceneReader, ReadsObstacles) {
  const SceneConfig scene = read(kFullScene);
  ASSERT_EQ(scene.obstacles.size(), 5U);
  const auto& plane = std::get<PlaneObstacleConfig>(scene.obstacles[0].geometry);
  EXPECT_EQ(scene.obstacles[0].name, "ground");
  EXPECT_EQ(scene.obstacles[0].friction, 0.3);
  expectClose(plane.point, {0, 0, 1});
  expectClose(plane.normal, {0, 0.6, 0.8});
  const auto& box = std::get<BoxObstacleConfig>(scene.obstacles[1].geometry);
  EXPECT_EQ(scene.obstacles[1].name, "obstacle-2");
  EXPECT_FALSE(scene.obstacles[1].friction.has_value());
  expectClose(box.pose.position, {1, 2, 3});
  expectClose(box.pose.rotation * Vec3::UnitY(), Vec3::UnitZ());
  expectClose(box.half_extents, {0.1, 0.2, 0.3});
  expectClose(std::get<SphereObstacleConfig>(scene.obstacles[2].geometry).center, {4, 5, 6});
  EXPECT_EQ(std::get<SphereObstacleConfig>(scene.obstacles[2].geometry).radius, 0.5);
  expectClose(std::get<CapsuleObstacleConfig>(scene.obstacles[3].geometry).b, {1, 0, 0});
  EXPECT_EQ(std::get<CapsuleObstacleConfig>(scene.obstacles[3].geometry).radius, 0.05);
  const auto& mesh = std::get<MeshObstacleConfig>(scene.obstacles[4].geometry);
  expectClose(std::get<BoxShapeConfig>(mesh.shape).size, {0.1, 0.1, 0.001});
  expectClose(mesh.pose.position, {7, 8, 9});
  expectClose(mesh.pose.rotation * Vec3::UnitZ(), Vec3::UnitX());
  EXPECT_EQ(scene.obstacles[4].friction, 0.4);
}

TEST(SceneReader, SmallSceneHasTheDefaultsOfItsStructs) {
  const SceneConfig scene = read(kSmallScene);
  const SceneConfig defaults;
  EXPECT_EQ(scene.gravity, defaults.gravity);
  EXPECT_EQ(scene.duration, defaults.duration);
  EXPECT_EQ(scene.visual_step, 0.033);
  EXPECT_EQ(scene.ticksPerStep(), 33);
  EXPECT_EQ(scene.latency, 1);
  EXPECT_EQ(scene.jitter, 0);
  EXPECT_FALSE(scene.safety.settings.passivity.enabled);
  EXPECT_EQ(scene.method, MethodName::live);
  EXPECT_EQ(scene.aim, AimName::sample);
  EXPECT_EQ(scene.substeps, 1);
  EXPECT_FALSE(scene.substeps_auto);
  EXPECT_TRUE(scene.tool.self_contact);
  EXPECT_FALSE(scene.contact.thickness.has_value());
  EXPECT_EQ(scene.contact.settings.max_recovery_speed, 0.5);
  EXPECT_TRUE(scene.contact.pairs.empty());
  EXPECT_FALSE(scene.contact.settings.cone.exact);
  EXPECT_EQ(scene.contact.settings.solver.tolerance, ContactSolverSettings{}.tolerance);
  EXPECT_EQ(scene.device.kind, DeviceName::simulated);
  EXPECT_EQ(scene.device.limits.peak_force, DeviceLimits{}.peak_force);
  EXPECT_EQ(scene.link.stiffness, DeviceLimits{}.stiffness);
  EXPECT_EQ(scene.safety.settings.max_slew, SafetySettings{}.max_slew);
  EXPECT_EQ(scene.device.mass, SimulatedDeviceSettings{}.mass);
  EXPECT_FALSE(scene.safety.model_age_limit || scene.tool.friction);
  EXPECT_EQ(scene.tool.handle, "top");
  EXPECT_TRUE(scene.tool.chosenHandle().hand.keyframes.empty());
  EXPECT_TRUE(scene.tool.chosenHandle().hand.smooth);
}

TEST(SceneReader, NumbersReadToTheLastDigit) {
  for (const auto& [text, value] :
       std::vector<std::pair<std::string, double>>{{"0.1", 0.1},
                                                   {"+3", 3.0},
                                                   {".5", 0.5},
                                                   {"1e-3", 0.001},
                                                   {"2.5E+1", 25.0},
                                                   {"7.", 7.0},
                                                   {"1.7976931348623157", 1.7976931348623157}}) {
    EXPECT_EQ(read(kSmallScene + "duration: " + text).duration, value) << text;
  }
}

TEST(SceneReader, ErrorsNameFileKeyLineAndRange) {
  EXPECT_EQ(
      rejectedChange("density: 250", "density: -3"),
      "s.yaml: tool.material.density (line 36): -3 is out of range; it must be above 0 and at most 100000 kg/m^3");
  EXPECT_EQ(
      rejectedChange("[0.1, -0.2, -9.5]", "[0.1, -0.2, .nan]"),
      "s.yaml: gravity[2] (line 4): nan is not a finite number; it must be at least -1000 and at most 1000 m/s^2");
}

TEST(SceneReader, UnknownKeysGetTheNearestKnownOne) {
  EXPECT_EQ(rejectedChange("density: 250", "densty: 250"),
            "s.yaml: tool.material (line 36): unknown key \"densty\"; the nearest known key is \"density\"");
  EXPECT_EQ(rejectedChange("gravity:", "gravtiy:"),
            "s.yaml: line 4: unknown key \"gravtiy\"; the nearest known key is \"gravity\"");
  EXPECT_EQ(
      rejectedChange("keyframes:", "key_frames:"),
      "s.yaml: tool.handles.grip.hand (line 54): unknown key \"key_frames\"; the nearest known key is \"keyframes\"");
  EXPECT_EQ(rejectedChange("{alien:", "{allien:"),
            "s.yaml: tool.shape (line 30): unknown key \"allien\"; the nearest known key is \"alien\"");
  const std::string strange = rejectedText(kSmallScene + "\"a\\nb" + std::string(500, 'x') + "\": 1\n");
  EXPECT_EQ(strange.find('\n'), std::string::npos);
  EXPECT_LT(strange.size(), 200U);
}

TEST(SceneReader, RejectsWhatIsNoScene) {
  EXPECT_EQ(rejectedText("42"), "s.yaml: line 1: must be a map with keys such as palpate");
  EXPECT_EQ(rejectedText("[1, 2]"), "s.yaml: line 1: must be a map with keys such as palpate");
  EXPECT_EQ(rejectedText("name: x\n"), "s.yaml: line 1: the key \"palpate\" is missing");
  EXPECT_EQ(rejectedChange("palpate: 1", "palpate: 2"),
            "s.yaml: palpate (line 1): schema version 2 is not known; this program reads version 1");
  EXPECT_EQ(rejectedText("palpate: 1\nname: x\n"), "s.yaml: line 1: the key \"tool\" is missing");
}

/// A change of the full scene, the key path that must be named and a part of the cause.
struct BadChange {
  const char* from;
  const char* to;
  const char* key;
  const char* cause;
};
void PrintTo(const BadChange& change, std::ostream* stream) { *stream << change.to; }

class SceneReaderRejects : public testing::TestWithParam<BadChange> {};

TEST_P(SceneReaderRejects, NamesKeyAndCause) {
  const std::string message = rejectedChange(GetParam().from, GetParam().to);
  EXPECT_EQ(message.rfind(std::string("s.yaml: ") + GetParam().key, 0), 0U) << message;
  EXPECT_NE(message.find(GetParam().cause), std::string::npos) << message;
  EXPECT_EQ(message.find('\n'), std::string::npos) << message;
}

const BadChange kBadTypes[] = {
    {"duration: 7", "duration: long", "duration (", "\"long\" is not a number"},
    {"duration: 7", "duration: 7s", "duration (", "\"7s\" is not a number"},
    {"duration: 7", "duration:", "duration (", "has no value"},
    {"duration: 7", "duration: [7]", "duration (", "is a list; it must be a number"},
    {"duration: 7", "duration: {s: 7}", "duration (", "is a map; it must be a number"},
    {"duration: 7", "duration: 1e999", "duration (", "too large or too small"},
    {"duration: 7", "duration: .inf", "duration (", "inf is not a finite number"},
    {"duration: 7", "duration: -.inf", "duration (", "-inf is not a finite number"},
    {"duration: 7", "duration: nan", "duration (", "nan is not a finite number"},
    {"latency: 2", "latency: 1.5", "latency (", "1.5 is not a whole number"},
    {"seed: 18446744073709551615", "seed: 18446744073709551616", "seed (", "not a whole number from 0"},
    {"seed: 18446744073709551615", "seed: -1", "seed (", "not a whole number from 0"},
    {"weight_compensation: true", "weight_compensation: 1", "weight_compensation (", "not one of false, true"},
    {"gravity: [0.1, -0.2, -9.5]", "gravity: -9.81", "gravity (", "must be a list"},
    {"gravity: [0.1, -0.2, -9.5]", "gravity: [0, -9.81]", "gravity (", "has 2 numbers; it must have 3"},
    {"gravity: [0.1, -0.2, -9.5]", "gravity: [0, 0, 0, 0]", "gravity (", "has 4 entries; at most 3"},
    {"name: everything", "name: [a]", "name (", "is a list; it must be a name"},
    {"name: everything", "name: a/b", "name (", "\"a/b\" is not a name"},
    {"name: everything", "name: \"\"", "name (", "is not a name"},
    {"name: everything", "name: ..", "name (", "is not a name"},
    {"description: all keys", "description: \"a\\0b\"", "description (", "zero byte"},
    {"visual: {step: 0.02, substeps: 3}", "visual: 0.02", "visual (", "must be a map with keys such as step"},
    {"visual: {step: 0.02, substeps: 3}", "visual: {}", "visual (", "the key \"step\" is missing"},
    {"cells: [2, 3, 4]", "cells: [2, 3]", "bodies[0].shape.bar.cells (", "it must have 3"},
    {"cells: [2, 3, 4]", "cells: [2, 3, 4.5]", "bodies[0].shape.bar.cells[2] (", "not a whole number"},
};

const BadChange kBadRanges[] = {
    {"duration: 7", "duration: 0", "duration (", "above 0 and at most 3600 s"},
    {"duration: 7", "duration: 4000", "duration (", "above 0 and at most 3600 s"},
    {"visual: {step: 0.02, substeps: 3}", "visual: {step: 0}", "visual.step (", "above 0 and at most 1 s"},
    {"haptic: {step: 0.002}", "haptic: {step: 0}", "haptic.step (", "at least 1e-05"},
    {"visual: {step: 0.02, substeps: 3}", "visual: {step: 0.021}",
     "visual.step:", "not a whole multiple of the haptic step, 0.002 s"},
    {"visual: {step: 0.02, substeps: 3}", "visual: {step: 0.0005}", "visual.step:", "not a whole multiple"},
    {"latency: 2", "latency: -1", "latency (", "at least 0 and at most 100"},
    {"jitter: 3", "jitter: 101", "jitter (", "at least 0 and at most 100"},
    {"max_damping: 1.5", "max_damping: -1", "safety.passivity.max_damping (", "at least 0"},
    {"method: hsl-exact", "method: hls", "method (", "\"hls\" is not one of live, hsl, hsl-exact, vc"},
    {"aim: predicted", "aim: guess", "aim (", "not one of sample, predicted"},
    {"derivative: full", "derivative: half", "linearization.derivative (", "not one of frozen, full"},
    {"cone: exact", "cone: round", "contact.cone (", "not one of polyhedral, exact"},
    {"facets: 12", "facets: 2", "contact.facets (", "at least 3 and at most 64"},
    {"friction: 0.7", "friction: -0.1", "contact.friction (", "at least 0"},
    {"friction: 0.9", "friction: -0.1", "tool.friction (", "at least 0"},
    {"friction: 0.2", "friction: -0.1", "bodies[0].friction (", "at least 0"},
    {"friction: 0.3", "friction: -0.1", "obstacles[0].friction (", "at least 0"},
    {"margin: 0.004", "margin: 0", "contact.margin (", "above 0 and at most 1 m"},
    {"penetration_tolerance: 2.0e-5", "penetration_tolerance: 0", "contact.penetration_tolerance (", "above 0"},
    {"max_passes: 6", "max_passes: 0", "contact.max_passes (", "at least 1"},
    {"max_iterations: 500", "max_iterations: 0", "contact.solver.max_iterations (", "at least 1"},
    {"tolerance: 1.0e-8", "tolerance: 1", "contact.solver.tolerance (", "above 0 and below 1"},
    {"youngs_modulus: 3.0e4", "youngs_modulus: 0", "tool.material.youngs_modulus (", "above 0 and at most 1e+12 Pa"},
    {"poisson_ratio: 0.3", "poisson_ratio: 0.5", "tool.material.poisson_ratio (", "above -1 and below 0.5"},
    {"poisson_ratio: 0.3", "poisson_ratio: -1", "tool.material.poisson_ratio (", "above -1 and below 0.5"},
    {"damping_alpha: 0.5", "damping_alpha: -1", "tool.material.damping_alpha (", "at least 0"},
    {"damping_beta: 0.001", "damping_beta: -1", "tool.material.damping_beta (", "at least 0"},
    {"mass: 0.03", "mass: -0.03", "tool.handles.grip.mass (", "above 0 and at most 100 kg"},
    {"inertia: [1.0e-5, 2.0e-5, 2.5e-5]", "inertia: [0, 1, 1]", "tool.handles.grip.inertia[0] (", "above 0"},
    {"inertia: [1.0e-5, 2.0e-5, 2.5e-5]", "inertia: [1, 1, 3]", "tool.handles.grip.inertia (", "exceeds the sum"},
    {"tetrahedra: 288", "tetrahedra: 200001", "tool.tetrahedra (", "at most 200000"},
    {"tetrahedra: 288", "tetrahedra: 9", "tool.tetrahedra (", "at least 10"},
    {"tetrahedra: 288", "tetrahedra: 200000", "", "at most 200000 are allowed"},
    {"cells: [2, 3, 4]", "cells: [2, 3, 0]", "bodies[0].shape.bar.cells[2] (", "at least 1 and at most 200"},
    {"cells: [2, 3, 4]", "cells: [200, 200, 200]", "", "the scene asks for"},
    {"height: 0.3", "height: 0", "tool.shape.alien.height (", "at least 0.01"},
    {"resolution: 0.03", "resolution: 0.001", "tool.shape.alien.resolution (", "at least 0.005"},
    {"size: [0.1, 0.2, 0.3]", "size: [0.1, 0, 0.3]", "bodies[0].shape.bar.size[1] (", "at least 0.0001"},
    {"size: 0.2, up", "size: -0.2, up", "bodies[1].shape.surface.size (", "at least 0.0001"},
    {"sphere: {radius: 0.05}", "sphere: {radius: 0}", "bodies[3].shape.sphere.radius (", "at least 0.0001"},
    {"length: 0.1", "length: 0.03", "bodies[4].shape.capsule (", "at least twice the radius"},
    {"position: [0.1, 0.2, 0.3]", "position: [0.1, 0.2, 300]", "tool.pose.position[2] (", "at most 100 m"},
    {"half_extents: [0.1, 0.2, 0.3]", "half_extents: [0.1, 0.2, 0]", "obstacles[1].box.half_extents[2] (",
     "at least 0.0001"},
    {"normal: [0, 3, 4]", "normal: [0, 0, 0]", "obstacles[0].plane.normal (", "zero vector"},
    {"normal: [0, 0, 4]", "normal: [0, 0, 0]", "tool.handles.top.region.halfspace.normal (", "zero vector"},
    {"min: [-1, -2, -3]", "min: [2, -2, -3]", "tool.handles.brick.region.box (", "min must not be above max"},
    {"t: 1.5", "t: 0", "tool.handles.grip.hand.keyframes[1] (", "t = 0 s is not later"},
    {"t: 1.5", "t: -1", "tool.handles.grip.hand.keyframes[1].t (", "at least 0"},
    {"- {t: 0}", "- {}", "tool.handles.grip.hand.keyframes[0] (", "the key \"t\" is missing"},
    {"stiffness: 600", "stiffness: 0", "link.stiffness (", "above 0 and at most 1e+06 N/m"},
    {"damping: 4,", "damping: -4,", "link.damping (", "at least 0"},
    {"peak_force: 7", "peak_force: 0", "link.peak_force (", "above 0 and at most 1e+06 N"},
    {"mass: 0.05", "mass: 0", "device.mass (", "above 0"},
    {"hand_stiffness: 400", "hand_stiffness: -1", "device.hand_stiffness (", "at least 0"},
    {"peak_force: 8", "peak_force: 1", "device.limits (", "continuous_force 2 N is above peak_force 1 N"},
    {"workspace_radius: 0.2", "workspace_radius: 0", "device.limits.workspace_radius (", "above 0"},
    {"max_slew: 500", "max_slew: 0", "safety.max_slew (", "above 0"},
    {"start_ramp: 0.3", "start_ramp: -1", "safety.start_ramp (", "at least 0"},
    {"gap_limit: 0.04", "gap_limit: 0", "safety.gap_limit (", "above 0"},
    {"gap_ramp: 0.7", "gap_ramp: -1", "safety.gap_ramp (", "at least 0"},
    {"model_age_limit: 0.2", "model_age_limit: 0", "safety.model_age_limit (", "above 0"},
    {"dead_man: 3", "dead_man: 33", "safety.dead_man (", "32"},
    {"start_gate: true", "start_gate: 2", "safety.start_gate (", ""},
    {"workspace: 0.15", "workspace: 0", "safety.workspace (", "above 0"},
    {"frozen_limit: 1.5", "frozen_limit: -1", "safety.frozen_limit (", "above 0"},
};

const BadChange kBadContact[] = {
    {"substeps: 3", "budget: 0", "visual.budget (", "above 0"},
    {"substeps: 3", "substeps: 0", "visual.substeps (", "at least 1 and at most 1000"},
    {"substeps: 3", "substeps: 2.5", "visual.substeps (", "2.5 is not a whole number"},
    {"substeps: 3", "substeps: many", "visual.substeps (", "\"many\" is neither auto nor a number"},
    {"substeps: 3", "substeps: [3]", "visual.substeps (", "is a list; it must be a number"},
    {"thickness: 0.0006", "thickness: 0", "contact.thickness (", "at least 1e-06 and at most 0.1 m"},
    {"max_recovery_speed: 0.25", "max_recovery_speed: 0", "contact.max_recovery_speed (", "above 0 and at most 100"},
    {"self_contact: false", "self_contact: no", "tool.self_contact (", "not one of false, true"},
    {"[tool, ground]", "[tool, grond]", "contact.pairs[0].between[1] (",
     "there is no tool, body or obstacle \"grond\"; the nearest is \"ground\""},
    {"[tool, ground]", "[tool]", "contact.pairs[0].between (", "has 1 names; it must have 2"},
    {"[tool, ground]", "[tool, ground, stone]", "contact.pairs[0].between (", "has 3 entries; at most 2"},
    {"[tool, ground]", "[obstacle-2, ground]", "contact.pairs[0].between (", "obstacles do not touch each other"},
    {"[tool, ground]", "[stone, stone]", "contact.pairs[0].between (", "a rigid body does not touch itself"},
    {"[tool, ground]", "[cushion, stone]", "contact.pairs[2] (", "the pair stone and cushion is given twice"},
    {"ground], friction: 0.8", "ground], friction: -1", "contact.pairs[0].friction (", "at least 0"},
    {"ground], friction: 0.8", "ground]", "contact.pairs[0] (", "the key \"friction\" is missing"},
};

const BadChange kBadBodies[] = {
    {"youngs_modulus: 5.0e4", "youngs_modulus: 0", "tool.material.parts[0].youngs_modulus (", "above 0"},
    {", youngs_modulus: 5.0e4", "", "tool.material.parts[0] (", "the key \"youngs_modulus\" is missing"},
    {"poisson_ratio: 0.2", "poisson_ratio: 0.5", "tool.material.parts[1].poisson_ratio (", "below 0.5"},
    {"density: 600", "density: 0", "tool.material.parts[1].density (", "above 0"},
    {"density: 600", "damping_beta: 0.1", "tool.material.parts[1] (", "unknown key \"damping_beta\""},
    {"sphere: {center: [0, 0, 0.25], radius: 0.06}", "landmark: {name: tail, radius: 0.06}",
     "tool.material.parts[1].region.landmark.name (", "not one of head"},
    {"sphere: {center: [0, 0, 0.25], radius: 0.06}", "", "tool.material.parts[1].region (", "has 0 of the keys sphere"},
    {"rigid: true", "rigid: maybe", "bodies[6].rigid (", "not one of false, true"},
    {"rigid: true", "rigid: false", "bodies[6].density (", "the density of a soft one is in its material"},
    {"rigid: true", "rigid: true\n    material: {density: 1}", "bodies[6].material (", "is for soft bodies"},
    {"rigid: true", "rigid: true\n    tetrahedra: 100", "bodies[6].tetrahedra (", "is for soft bodies"},
    {"rigid: true", "rigid: true\n    self_contact: true", "bodies[6].self_contact (", "is for soft bodies"},
    {"rigid: true", "rigid: true\n    start: settled", "bodies[6].start (", "a rigid body starts as it is placed"},
    {"density: 2600", "density: 0", "bodies[6].density (", "above 0"},
    {"{tetrahedra_file: b.msh}", "{tetrahedra_file: b.msh}\n    rigid: true", "bodies[5].shape (",
     "a rigid body needs a surface, not tetrahedra"},
    {"[0.02, 0.03], [0, 0.03]", "[0.02, 0.03]", "bodies[6].shape.revolution.profile (",
     "corner 1 touches the axis in a single point"},
    {"[0.02, 0.03], [0, 0.03]", "[0.02]", "bodies[6].shape.revolution.profile[2] (", "it must have 2, r and z"},
    {"[0.02, 0.03], [0, 0.03]", "[-1, 0.03]", "bodies[6].shape.revolution.profile[2][0] (", "at least 0"},
    {"segments: 24", "segments: 4", "bodies[6].shape.revolution.segments (", "at least 8 and at most 512"},
    {"{box: {size: [0.1, 0.1, 0.001]}}", "{bar: {size: [1, 1, 1], cells: [1, 1, 1]}}", "obstacles[4].mesh (",
     "an obstacle needs a surface, not tetrahedra"},
    {"{box: {size: [0.1, 0.1, 0.001]}}", "{}", "obstacles[4].mesh.shape (", "has 0 of the keys alien"},
};

const BadChange kBadReferences[] = {
    {"handle: grip", "handle: gripp", "tool.handle (", "the tool has no handle \"gripp\"; the nearest is \"grip\""},
    {"name: left_hand", "name: tail", "tool.handles.grip.region.landmark.name (", "not one of head"},
    {"shape: {alien: {height: 0.3, resolution: 0.03}}", "shape: {sphere: {radius: 0.1}}",
     "tool.handles.grip.region.landmark (", "only the shape alien has landmarks"},
    {"region: {sphere: {center: [0.01, 0.02, 0.03], radius: 0.04}}", "mass: 1", "tool.handles.ball (",
     "the key \"region\" is missing"},
    {"sphere: {center: [0.01, 0.02, 0.03], radius: 0.04}", "spheres: {centers: [], radius: 0.04}",
     "tool.handles.ball.region.spheres.centers (", "is empty"},
    {"sphere: {center: [0.01, 0.02, 0.03], radius: 0.04}", "spheres: {centers: [[0, 1]], radius: 0.04}",
     "tool.handles.ball.region.spheres.centers[0] (", "has 2 numbers"},
    {"sphere: {center: [0.01, 0.02, 0.03], radius: 0.04}", "spheres: {centers: [[0, 0, 1]], radius: 0}",
     "tool.handles.ball.region.spheres.radius (", "out of range"},
    {"region: {sphere: {center: [0.01, 0.02, 0.03], radius: 0.04}}", "region: {}", "tool.handles.ball.region (",
     "has 0 of the keys sphere, box, capsule, halfspace, landmark, spheres; it must have exactly one"},
    {"    ball:", "    \"a b\":", "tool.handles (", "\"a b\" is not a name"},
    {"    ball:", "    grip:", "line ", "the key 'grip' is given twice"},
    {"  - {sphere: {center: [4, 5, 6], radius: 0.5}}", "  - {name: none}", "obstacles[2] (", "has 0 of the keys plane"},
    {"  - {sphere: {center: [4, 5, 6], radius: 0.5}}", "  - {plane: {}, sphere: {center: [4, 5, 6], radius: 0.5}}",
     "obstacles[2] (", "has 2 of the keys plane"},
    {"name: cushion", "name: tool", "bodies[0] (", "the name \"tool\" is given twice"},
    {"name: cushion", "name: body-2", "bodies[1] (", "the name \"body-2\" is given twice"},
    {"name: ground", "name: cushion", "obstacles[0] (", "the name \"cushion\" is given twice"},
    {"start: settled", "start: asleep", "bodies[0].start (", "not one of rest, settled"},
    {"file: a.obj, size: 0.2", "size: 0.2", "bodies[1].shape.surface (", "the key \"file\" is missing"},
    {"file: a.obj", "file: \"\"", "bodies[1].shape.surface.file (", "a file name is needed"},
    {"file: a.obj", "file: a.obj, package: ..", "bodies[1].shape.surface.package (", "is not a name"},
    {"file: a.obj", "file: ../a.obj, package: p", "bodies[1].shape.surface (", "has no .."},
    {"file: a.obj", "file: /a.obj, package: p", "bodies[1].shape.surface (", "relative to the package's data folder"},
    {"up: y", "up: down", "bodies[1].shape.surface.up (", "not one of x, y, z"},
    {"start: settled", "tetrahedra: 300", "bodies[0].tetrahedra (", "tetrahedra of its own"},
    {"type: recorded", "type: simulated", "device (", "only a recorded device has a file"},
    {"  file: motion.csv\n", "", "device (", "a recorded device needs a file"},
    {"type: recorded", "type: omni", "device.type (", "not one of simulated, prescribed, recorded"},
};

INSTANTIATE_TEST_SUITE_P(Types, SceneReaderRejects, testing::ValuesIn(kBadTypes));
INSTANTIATE_TEST_SUITE_P(Ranges, SceneReaderRejects, testing::ValuesIn(kBadRanges));
INSTANTIATE_TEST_SUITE_P(Contact, SceneReaderRejects, testing::ValuesIn(kBadContact));
INSTANTIATE_TEST_SUITE_P(Bodies, SceneReaderRejects, testing::ValuesIn(kBadBodies));
INSTANTIATE_TEST_SUITE_P(References, SceneReaderRejects, testing::ValuesIn(kBadReferences));

TEST(SceneReader, RejectsTooManyOfAnything) {
  const auto list = [](const std::string& item, int count) {
    std::string text = "[";
    for (int i = 0; i < count; ++i) text += (i > 0 ? ", " : "") + item;
    return text + "]";
  };
  EXPECT_NE(rejectedText(kSmallScene + "obstacles: " + list("{plane: {}}", 1001)).find("at most 1000"),
            std::string::npos);
  EXPECT_NE(rejectedText(kSmallScene + "bodies: " + list("{shape: {alien: {}}}", 101)).find("at most 100"),
            std::string::npos);
  EXPECT_NE(
      rejectedText(kSmallScene + "      hand: {keyframes: " + list("{t: 1}", 10001) + "}\n").find("at most 10000"),
      std::string::npos);
  std::string many_handles = kSmallScene;
  for (int i = 0; i < 50; ++i)
    many_handles += fmt::format("    h{}: {{region: {{sphere: {{center: [0, 0, 0], radius: 1}}}}}}\n", i);
  EXPECT_NE(rejectedText(many_handles).find("tool.handles (line 6): has 51 entries; at most 50"), std::string::npos);
  EXPECT_NE(rejectedText("palpate: 1\nname: x\ntool: {shape: {alien: {}}, handles: {}}\n").find("at least one handle"),
            std::string::npos);
}

TEST(SceneReader, RejectsARunThatIsTooLongForItsStep) {
  EXPECT_EQ(rejectedText(kSmallScene + "duration: 3600\nhaptic: {step: 0.0001}\nvisual: {step: 0.01}\n"),
            "s.yaml: duration: 3600 s at a haptic step of 0.0001 s are more than 1e+07 ticks");
}

// An alias bomb cannot grow: the schema bounds every list by a count, and aliases are not copied.
TEST(SceneReader, AliasesWorkWithinTheSchema) {
  const SceneConfig scene =
      read(kSmallScene + "gravity: &g [0, 0, -1]\nbodies: [&b {shape: {sphere: {radius: 0.1}}, velocity: *g}, *b]\n");
  ASSERT_EQ(scene.bodies.size(), 2U);
  EXPECT_EQ(scene.bodies[1].name, "body-2");
  expectClose(scene.bodies[1].velocity, {0, 0, -1});
}

TEST(SceneReader, ReadsAWanderingHand) {
  const auto hand = [](const std::string& wander) { return kSmallScene + "      hand: {wander: {" + wander + "}}\n"; };
  const SceneConfig scene =
      read(hand("band: 5, from: 1, to: 3.5, position: [0.001, 0, 0.002], rotation: [0, 90, 0], seed: 7"));
  const Wander& wander = scene.tool.chosenHandle().hand.wander;
  EXPECT_EQ(wander.band, 5);
  EXPECT_EQ(wander.from, 1);
  EXPECT_EQ(wander.to, 3.5);
  EXPECT_EQ(wander.seed, 7U);
  expectClose(wander.position, {0.001, 0, 0.002});
  expectClose(wander.rotation, {0, kPi / 2, 0});
  EXPECT_EQ(read(kSmallScene).tool.chosenHandle().hand.wander.band, 0);
  EXPECT_NE(rejectedText(hand("from: 1, to: 2")).find("\"band\" is missing"), std::string::npos);
  EXPECT_NE(rejectedText(hand("band: 60, from: 1, to: 2")).find("at most 50 Hz"), std::string::npos);
  EXPECT_NE(rejectedText(hand("band: 5, from: 2, to: 2")).find("not later than 2 s"), std::string::npos);
}

}  // namespace
}  // namespace palpate
