#include "palpate/protocol/messages.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "palpate/haptics/coupling.h"
#include "palpate/session/lockstep.h"
#include "shared/soft_cube.h"

namespace palpate {
namespace {

using test::softCube;

/// Reads a message as the page does, apart from the code that writes it.
class Reader {
 public:
  explicit Reader(const std::string& bytes) : bytes_(bytes) {}
  std::uint32_t u32() { return get<std::uint32_t>(); }
  double f32() { return get<float>(); }
  double f64() { return get<double>(); }
  Vec3 vec3() {
    Vec3 v;
    for (int k = 0; k < 3; ++k) v[k] = f32();
    return v;
  }
  Vec6 vec6() {
    Vec6 v;
    for (int k = 0; k < 6; ++k) v[k] = f32();
    return v;
  }
  std::vector<double> f32s(std::size_t n) {
    std::vector<double> out;
    for (std::size_t k = 0; k < n; ++k) out.push_back(f32());
    return out;
  }
  std::vector<std::uint32_t> u32s(std::size_t n) {
    std::vector<std::uint32_t> out;
    for (std::size_t k = 0; k < n; ++k) out.push_back(u32());
    return out;
  }
  bool atEnd() const { return at_ == bytes_.size(); }

 private:
  template <typename T>
  T get() {
    T value;
    EXPECT_LE(at_ + sizeof value, bytes_.size());
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  const std::string& bytes_;
  std::size_t at_ = 0;
};

TEST(ViewerMessages, GeometryHoldsWhatTheSurfacesNeed) {
  const BuiltScene scene = buildScene(softCube());
  const std::string bytes = geometryMessage(scene.world, 5);
  Reader in(bytes);
  EXPECT_EQ(in.u32(), 1u);
  EXPECT_EQ(in.u32(), 5u);
  ASSERT_EQ(in.u32(), 2u);
  ASSERT_EQ(in.u32(), 2u);
  for (int i = 0; i < 2; ++i) {
    const SimulationMesh& mesh = scene.world.body(i).model.mesh();
    const auto sizes = in.u32s(4);
    EXPECT_EQ(in.u32(), i == 0 ? 1u : 2u);
    ASSERT_EQ(sizes[0], mesh.mesh.nodes.size());
    ASSERT_EQ(sizes[1], mesh.surface.vertices.size());
    ASSERT_EQ(sizes[2], mesh.surface.triangles.size());
    ASSERT_EQ(sizes[3], mesh.mesh.tetrahedra.size());
    const auto nodes = in.f32s(3 * sizes[0]);
    const auto held = in.f32s(sizes[0]);
    in.u32s(4 * sizes[3]);
    const auto carriers = in.u32s(4 * sizes[1]);
    const auto weights = in.f32s(4 * sizes[1]);
    in.u32s(3 * sizes[2]);
    double held_nodes = 0;
    for (const double h : held) held_nodes += h;
    EXPECT_EQ(held_nodes, i == 0 ? 9 : 0);  // the top layer of 3 x 3 nodes
    for (std::size_t v = 0; v < sizes[1]; ++v) {
      Vec3 p = Vec3::Zero();
      for (int k = 0; k < 4; ++k) {
        for (int c = 0; c < 3; ++c) p[c] += weights[4 * v + k] * nodes[3 * carriers[4 * v + k] + c];
      }
      EXPECT_LT((p - mesh.surface.vertices[v]).norm(), 1e-6);
    }
  }
  EXPECT_EQ(in.u32(), 0u);
  EXPECT_EQ(in.u32() + in.u32(), 0u);
  EXPECT_EQ(in.vec3(), Vec3::Zero());
  EXPECT_EQ(in.vec3(), Vec3::UnitZ());
  EXPECT_EQ(in.u32(), 1u);
  const std::uint32_t vertices = in.u32(), triangles = in.u32();
  EXPECT_GE(triangles, 12u);
  in.f32s(3 * vertices);
  for (const auto v : in.u32s(3 * triangles)) EXPECT_LT(v, vertices);
  EXPECT_TRUE(in.atEnd());
}

TEST(ViewerMessages, FrameHoldsTheStateAfterAStep) {
  SceneConfig config = softCube();
  config.duration = 0.6;
  BuiltScene scene = buildScene(config);
  runLockstep(scene, timingOf(config), {});
  const StateReader reader(scene.world);
  SceneState state;
  state.step = 30;
  reader.read(scene.world, true, state);
  TickRecord tick;
  tick.time = 0.6;
  tick.sent << 1, 2, 3, 4, 5, 6;
  const std::string full = frameMessage(state, tick, 9, 2, true);
  Reader in(full);
  EXPECT_EQ(in.u32s(4), (std::vector<std::uint32_t>{2, 2, 30, 9}));
  EXPECT_EQ(in.f64(), 0.6);
  in.f32s(14);
  const Pose& handle = scene.world.tool().state.handle.pose;
  EXPECT_LT((in.vec3() - handle.position).norm(), 1e-6);
  EXPECT_NEAR(in.f32(), handle.rotation.w(), 1e-6);
  in.f32s(3);
  EXPECT_EQ(in.vec6(), tick.sent);
  EXPECT_EQ(in.u32(), 0u);
  const std::uint32_t values = in.u32(), contacts = in.u32(), stresses = in.u32();
  const VecX& x = scene.world.tool().state.positions;
  ASSERT_EQ(values, x.size() + 12);
  EXPECT_EQ(stresses, values / 3);
  const auto nodes = in.f32s(values);
  for (Eigen::Index k = 0; k < x.size(); ++k) EXPECT_NEAR(nodes[k], x[k], 1e-6);
  const auto stress = in.f32s(stresses);
  EXPECT_GT(*std::max_element(stress.begin(), stress.end()), 100.0);  // pressed by about a sixth of its height
  ASSERT_GT(contacts, 0u);
  double up = 0;
  for (std::uint32_t c = 0; c < contacts; ++c) {
    EXPECT_NEAR(in.vec3().z(), 0.0, 1e-4);
    EXPECT_EQ(in.vec3(), Vec3::UnitZ());
    up += in.vec3().z();
    in.f32();
  }
  EXPECT_GT(up, 0.0);
  EXPECT_TRUE(in.atEnd());
  const std::string light = frameMessage(state, tick, 9, 2, false);
  EXPECT_EQ(light, full.substr(0, light.size() - 12) + std::string(12, '\0'));
}

// A bar pulled along one axis, laterally free: von Mises stress is Young's modulus times strain.
TEST(ViewerMessages, StressOfUniaxialStrain) {
  BuiltScene scene = buildScene(softCube());
  const Body tool = scene.world.tool();
  BodyState state = tool.state;
  const double strain = 1e-3, ratio = 0.4;
  for (int n = 0; n < tool.model.nodes(); ++n) {
    const Vec3& rest = tool.model.mesh().mesh.nodes[n];
    state.positions.segment<3>(3 * n) = rest.cwiseProduct(Vec3(1 + strain, 1 - ratio * strain, 1 - ratio * strain));
  }
  std::fill(state.elastic.rotations.begin(), state.elastic.rotations.end(), Mat3::Identity());
  scene.world.setBody(scene.world.toolIndex(), state);
  const StateReader reader(scene.world);
  SceneState out;
  reader.read(scene.world, true, out);
  for (int n = 0; n < tool.model.nodes(); ++n) EXPECT_NEAR(out.stress[n], 2e4 * strain, 2e-3 * 2e4 * strain);
}

TEST(ViewerMessages, SamplesHoldEveryRow) {
  LinkParameters link;
  SampleEncoder encoder(link, Vec3(0, 0, -0.5), 3);
  VisualRecord step;
  step.time = 0.02;
  step.model.time = 0.02;
  step.model.handle_pose.position = Vec3(0.001, 0, 0);
  step.model.force << 7, 0, 0, 0, 0, 0;
  step.step.contacts = 4;
  step.step.times.contact = 0.002;
  encoder.add(step, 2);
  for (int k = 0; k < 5; ++k) {
    TickRecord tick;
    tick.time = 0.04 + 0.001 * k;
    tick.model_age = tick.time - 0.02;
    tick.sent[0] = k;
    tick.raw[1] = -k;
    tick.flags.set(TickFlag::force_clamped);
    encoder.add(tick);
  }
  const std::string bytes = encoder.take();
  EXPECT_TRUE(encoder.empty());
  Reader in(bytes);
  EXPECT_EQ(in.u32s(6), (std::vector<std::uint32_t>{3, 3, 5, 1, 0, 0}));
  EXPECT_EQ(in.f64(), 0.04);
  for (int k = 0; k < 5; ++k) {
    EXPECT_NEAR(in.f32(), 0.001 * k, 1e-9);
    EXPECT_EQ(in.vec6()[0], k);
    EXPECT_EQ(in.vec6()[1], -k);
    EXPECT_NEAR(in.vec6()[0], link.stiffness * 0.001, 1e-5);  // what virtual coupling would give
    EXPECT_EQ(in.u32(), 1u << static_cast<unsigned>(TickFlag::force_clamped));
  }
  const auto row = in.f32s(28);
  EXPECT_NEAR(row[0], -0.02, 1e-7);
  EXPECT_EQ(row[1], 7);
  EXPECT_EQ(row[3], -0.5);  // the handle's weight
  EXPECT_NEAR(row[7], 2.0, 1e-5);
  EXPECT_NEAR(row[11], 2.0, 1e-5);
  EXPECT_EQ(row[16], 4);
  EXPECT_EQ(row[26], 2);
  EXPECT_TRUE(in.atEnd());
}

TEST(ViewerMessages, SceneTellsWhereBodiesAreAttached) {
  SceneConfig config = softCube();
  const auto told = [&] {
    return nlohmann::json::parse(sceneMessage(config, buildScene(config), {{"a", "b", "c.yaml"}}, 4))["bodies"];
  };
  for (const auto& body : told()) EXPECT_TRUE(body["attachments"].empty());
  FreeBodyConfig slab;
  slab.name = "slab";
  slab.shape = BarShapeConfig{Vec3(0.1, 0.1, 0.02), {2, 2, 1}};
  slab.pose.position = {0, 0, 2.0};
  FreeBodyConfig lid = slab;
  lid.name = "lid";
  lid.pose.position.z() += 0.02;
  const auto low = [](const char* name, const char* to) {
    AttachmentConfig out;
    out.name = name;
    out.region = HalfspaceRegionConfig{Vec3(0, 0, 1e-4), -Vec3::UnitZ()};
    out.to = to;
    return out;
  };
  slab.attachments = {low("floor", "")};
  lid.attachments = {low("seam", "slab")};
  config.bodies.push_back(slab);
  config.bodies.push_back(lid);
  const auto bodies = told();
  ASSERT_EQ(bodies.size(), 4U);
  EXPECT_EQ(bodies[2]["attachments"][0]["kind"], "fixed");
  EXPECT_EQ(bodies[2]["attachments"][0]["nodes"].size(), 9U);
  EXPECT_EQ(bodies[2]["attachments"][0]["to"], "");
  EXPECT_EQ(bodies[3]["attachments"][0]["name"], "seam");
  EXPECT_EQ(bodies[3]["attachments"][0]["kind"], "glued");
  EXPECT_EQ(bodies[3]["attachments"][0]["to"], "slab");
}

TEST(ViewerMessages, TextsAreOneLineOfJson) {
  const auto notice = nlohmann::json::parse(noticeMessage(true, "two\nlines \xff"));
  EXPECT_EQ(notice["level"], "error");
  EXPECT_EQ(notice["text"].get<std::string>().find('\n'), std::string::npos);
  const SceneConfig config = softCube();
  const BuiltScene scene = buildScene(config);
  const auto json = nlohmann::json::parse(sceneMessage(config, scene, {{"a", "b", "c.yaml"}}, 4));
  EXPECT_EQ(json["generation"], 4);
  EXPECT_EQ(json["bodies"].size(), 2u);
  EXPECT_EQ(json["bodies"][1]["kind"], "rigid");
  EXPECT_EQ(json["handles"].size(), 2u);
  EXPECT_EQ(json["scenes"][0]["name"], "a");
  PeriodicReport report;
  for (int k = 1; k <= 1000; ++k) report.work.add(1000 * k);
  const auto stats = nlohmann::json::parse(statsMessage({}, report));
  std::uint64_t sum = 0;
  for (const auto& bin : stats["tick_us"]["bins"]) sum += bin[1].get<std::uint64_t>();
  EXPECT_EQ(sum, 1000u);
  EXPECT_TRUE(stats["realtime"].is_null());
}

}  // namespace
}  // namespace palpate
