// What the program and the page are both held to. Three files are compared here with the program and in
// web/test/shared.test.ts with the page, so that neither can change alone:
//   web/src/protocol.json    numbers of kinds, columns, limits; the page is built with it
//   web/test/messages.json   a message of every kind as the program writes it, and what it says
//   web/test/commands.json   a command of every kind as the page writes it
// After a change that is meant, PALPATE_WRITE_PROTOCOL=1 makes this test write the first two; npm test writes the third
// in the same way.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "palpate/haptics/coupling.h"
#include "palpate/protocol/commands.h"
#include "palpate/protocol/description.h"
#include "palpate/protocol/layout.h"
#include "palpate/protocol/messages.h"
#include "palpate/protocol/server_messages.h"
#include "palpate/scene/reader.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::uint32_t kGeneration = 7;

std::string pathOf(const char* name) { return std::string(PALPATE_SOURCE_DIR) + "/web/" + name; }

std::string fileText(const char* name) {
  std::ifstream in(pathOf(name), std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

bool writes() { return std::getenv("PALPATE_WRITE_PROTOCOL") != nullptr; }

// --- samples

/// One cell of a bar over the ground, a stone beside it and a box.
const SceneConfig& tinyConfig() {
  static const SceneConfig config = readSceneFromString(R"(
palpate: 1
name: tiny
description: one of everything
method: hsl-exact
visual: {step: 0.02}
haptic: {step: 0.002}
gravity: [0.5, 0, -9.5]
tool:
  shape: {bar: {size: [0.0625, 0.0625, 0.125], cells: [1, 1, 1]}}
  handles:
    top: {region: {halfspace: {point: [0, 0, 0.12], normal: [0, 0, 1]}}}
bodies:
  - name: stone
    rigid: true
    shape: {revolution: {profile: [[0, 0], [0.0625, 0], [0, 0.0625]], segments: 8}}
    pose: {position: [0.5, 0, 0]}
obstacles:
  - {name: ground, plane: {point: [0, 0, -0.25], normal: [0, 0, 1]}}
  - {name: box, box: {center: [0, 0.5, 0], half_extents: [0.125, 0.125, 0.125]}}
device: {limits: {peak_force: 5.5, peak_torque: 0.25, workspace_radius: 0.375}}
link: {stiffness: 650}
)",
                                                        "tiny.yaml");
  return config;
}

Json floats(const std::vector<float>& values) {
  Json out = Json::array();
  for (const float v : values) out.push_back(static_cast<double>(v));
  return out;
}

template <class Vector>
Json floatsOf(const Vector& v) {
  Json out = Json::array();
  for (int k = 0; k < v.size(); ++k) out.push_back(static_cast<double>(static_cast<float>(v[k])));
  return out;
}

Json poseJson(const Pose& pose) {
  const Quat& q = pose.rotation;
  return {{"position", floatsOf(pose.position)}, {"rotation", {q.w(), q.x(), q.y(), q.z()}}};
}

template <class Rows>
Json flattened(const Rows& rows) {
  Json out = Json::array();
  for (const auto& row : rows) {
    for (const auto& v : row) out.push_back(v);
  }
  return out;
}

template <class Points>
Json flatPoints(const Points& points) {
  Json out = Json::array();
  for (const Vec3& p : points) {
    for (const Json& v : floatsOf(p)) out.push_back(v);
  }
  return out;
}

Json bodyFields(const World& world, int index) {
  const Body body = world.body(index);
  const SimulationMesh& mesh = body.model.mesh();
  Json held = Json::array(), nodes = Json::array(), weights = Json::array();
  for (const int attached : body.model.attachedIndex()) held.push_back(body.model.held() && attached >= 0 ? 1 : 0);
  for (const EmbeddedPoint& p : mesh.embedding) {
    for (const int node : mesh.mesh.tetrahedra[p.tetrahedron]) nodes.push_back(node);
    for (const double w : p.weights) weights.push_back(static_cast<double>(static_cast<float>(w)));
  }
  return {{"nodes", flatPoints(mesh.mesh.nodes)},
          {"held", held},
          {"tetrahedra", flattened(mesh.mesh.tetrahedra)},
          {"vertex_nodes", nodes},
          {"vertex_weights", weights},
          {"triangles", flattened(mesh.surface.triangles)},
          {"tool", index == world.toolIndex()},
          {"rigid", body.model.isRigid()}};
}

Json geometryFields(const World& world) {
  Json bodies = Json::array();
  for (int i = 0; i < world.bodies(); ++i) bodies.push_back(bodyFields(world, i));
  const Surface box = surfaceOf(world.obstacles.at(1)).value();
  const Json plane{{"shape", "plane"}, {"point", {0, 0, -0.25}}, {"normal", {0, 0, 1}}};
  const Json surface{
      {"shape", "surface"}, {"vertices", flatPoints(box.vertices)}, {"triangles", flattened(box.triangles)}};
  return {{"type", "geometry"}, {"generation", kGeneration}, {"bodies", bodies}, {"obstacles", {plane, surface}}};
}

/// Numbers that binary floats hold exactly, every one another.
struct Frame {
  SceneState state;
  TickRecord tick;
};
Pose poseOf(double x, const Quat& rotation) { return {Vec3(x, x + 0.25, x + 0.5), rotation}; }

Frame frameSample() {
  Frame f;
  f.state.step = 45;
  f.state.handle = poseOf(3, Quat(0, 0, 1, 0));
  f.state.nodes = {1, 2, 3, 4, 5, 6};
  f.state.stress = {100, 200};
  f.state.contacts = {0.5, 1.5, 2.5, 0, 0, 1, 7, 8, 9, 2};
  f.tick.time = 1.25;
  f.tick.device.pose = poseOf(1, Quat(1, 0, 0, 0));
  f.tick.proxy = poseOf(2, Quat(0, 1, 0, 0));
  f.tick.sent << 1, 2, 3, 4, 5, 6;
  f.tick.flags.set(TickFlag::slew_limited);
  return f;
}

Json frameFields(const Frame& f, bool nodes) {
  Json out{{"type", "frame"},
           {"generation", kGeneration},
           {"step", f.state.step},
           {"hand_seq", 12},
           {"time", f.tick.time},
           {"device", poseJson(f.tick.device.pose)},
           {"proxy", poseJson(f.tick.proxy)},
           {"handle", poseJson(f.state.handle)},
           {"wrench", floatsOf(f.tick.sent)},
           {"flags", f.tick.flags.bits()},
           {"nodes", Json::array()},
           {"stress", Json::array()},
           {"contacts", Json::array()}};
  if (nodes) {
    out["nodes"] = floats(f.state.nodes);
    out["stress"] = floats(f.state.stress);
    const std::vector<float>& c = f.state.contacts;
    out["contacts"] = Json::array({{{"position", {c[0], c[1], c[2]}},
                                    {"normal", {c[3], c[4], c[5]}},
                                    {"force", {c[6], c[7], c[8]}},
                                    {"state", c[9]}}});
  }
  return out;
}

Vec6 six(double first) {
  Vec6 v;
  for (int k = 0; k < 6; ++k) v[k] = first + k;
  return v;
}

/// A batch of one step and one tick, and what each column of them must say.
std::pair<std::string, Json> samplesSample() {
  SampleEncoder encoder({512, 0, 0, 0}, Vec3(0, 0, -0.5), kGeneration);
  VisualRecord step;
  step.time = 2.0;
  step.model.time = 2.0;
  step.model.force = six(10);
  step.model.handle_pose.position = Vec3(0.5, 0.25, 0.125);
  step.linearization_s = 0.5;
  step.lateness_s = 0.25;
  StepReport& s = step.step;
  s.times = {1, 2, 3, 4, 5};
  s.contacts_found = 21;
  s.contacts = 22;
  s.active = 23;
  s.sticking = 24;
  s.sliding = 25;
  s.solver_iterations = 26;
  s.solver_residual = 27;
  s.penetration = 28;
  s.kinetic_energy = 29;
  s.elastic_energy = 30;
  s.status = StepStatus::restored;
  TickRecord tick;
  tick.time = 2.5;
  tick.model_age = 0.5;
  tick.sent = six(40);
  tick.raw = six(50);
  tick.flags.set(TickFlag::device_rejected);
  tick.flags.set(TickFlag::passivity_damped);
  encoder.add(step, 3);
  encoder.add(tick);
  const StepTimes& t = s.times;
  const Json tick_row{{"time", 0},
                      {"sent", floatsOf(tick.sent)},
                      {"raw", floatsOf(tick.raw)},
                      {"vc", {256, 128, 64, 0, 0, 0}},
                      {"flags", tick.flags.bits()}};
  const Json step_row{{"time", -0.5},
                      {"wrench", {10, 11, 11.5, 13, 14, 15}},
                      {"milliseconds",
                       {1e3 * (t.total() + 0.5), 1e3 * t.assemble, 1e3 * t.factorize, 1e3 * t.solve, 1e3 * t.contact,
                        1e3 * t.advance, 500}},
                      {"lateness", 250},
                      {"found", 21},
                      {"reduced", 22},
                      {"active", 23},
                      {"sticking", 24},
                      {"sliding", 25},
                      {"iterations", 26},
                      {"residual", 27},
                      {"penetration", 28},
                      {"kinetic", 29},
                      {"elastic", 30},
                      {"status", static_cast<int>(StepStatus::restored)},
                      {"substeps", 3},
                      {"reserved", 0}};
  return {encoder.take(),
          {{"type", "samples"},
           {"generation", kGeneration},
           {"lost", 0},
           {"t0", 2.5},
           {"ticks", Json::array({tick_row})},
           {"steps", Json::array({step_row})}}};
}

std::vector<std::string> texts(const BuiltScene& scene) {
  InteractiveSettings settings;
  settings.friction = 0.5;
  settings.stiffness = 2;
  settings.speed = 0.25;
  settings.paused = settings.stress = true;
  InteractiveStatus status;
  status.hand = 3;
  status.on_path = false;
  status.viewers = 4;
  status.recording = "out/recorded";
  status.busy = "meshing";
  status.motion = Motion::over;
  status.placing = SurfacePreview{"own.obj", Vec3(1, 2, 4), 0.125};
  LoopFigures figures;
  figures.ticks = 1001;
  figures.missed = 2;
  figures.dropped = 3;
  figures.delivered_energy = -0.125;
  figures.server_share = 0.0625;
  figures.realtime_note = "refused";
  PeriodicReport report;
  for (const int ns : {1000, 2000, 3000}) {
    report.work.add(ns);
    report.wake_latency.add(10 * ns);
  }
  return {welcomeMessage(5, "1.2.3"),
          sceneMessage(tinyConfig(), scene, {{"tiny", "one of everything", {}}, {"other", "else", {}}}, kGeneration),
          stateMessage(tinyConfig(), settings, status, kGeneration),
          stateMessage(tinyConfig(), {}, {}, kGeneration),
          statsMessage(figures, report),
          noticeMessage(true, "what went wrong"),
          noticeMessage(false, "what happened"),
          savedMessage("tiny.yaml", "palpate: 1\nname: \"tiny\"\n")};
}

std::string hex(const std::string& bytes) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string out;
  for (const char c : bytes) {
    out += kDigits[static_cast<unsigned char>(c) >> 4];
    out += kDigits[static_cast<unsigned char>(c) & 15];
  }
  return out;
}

Json messages() {
  const BuiltScene scene = buildScene(tinyConfig());
  const Frame frame = frameSample();
  const auto [samples, samples_fields] = samplesSample();
  Json out;
  out["session"] = sessionMessage({"view", "1.2.3", "tiny", 12345});
  out["texts"] = texts(scene);
  out["binary"] = Json::array();
  const auto add = [&](const std::string& bytes, const Json& fields) {
    out["binary"].push_back({{"bytes", hex(bytes)}, {"fields", fields}});
  };
  add(geometryMessage(scene.world, kGeneration), geometryFields(scene.world));
  add(frameMessage(frame.state, frame.tick, 12, kGeneration, true), frameFields(frame, true));
  add(frameMessage(frame.state, frame.tick, 12, kGeneration, false), frameFields(frame, false));
  add(samples, samples_fields);
  return out;
}

// --- comparison

/// Numbers to 1e-6, as another compiler may round a mesh's otherwise; the rest exactly.
bool alike(const Json& a, const Json& b) {
  if (a.is_number() && b.is_number()) {
    const double x = a.get<double>(), y = b.get<double>();
    return std::abs(x - y) <= 1e-6 * std::max(1.0, std::abs(x));
  }
  if (a.type() != b.type() || a.size() != b.size()) return false;
  if (a.is_object()) {
    return std::equal(a.items().begin(), a.items().end(), b.items().begin(),
                      [](const auto& x, const auto& y) { return x.key() == y.key() && alike(x.value(), y.value()); });
  }
  return a.is_array() ? std::equal(a.begin(), a.end(), b.begin(), alike) : a == b;
}

std::uint32_t word(const std::string& digits, std::size_t index) {
  std::uint32_t out = 0;
  for (std::size_t k = 4; k-- > 0;)
    out = out << 8 | static_cast<std::uint32_t>(std::stoul(digits.substr(8 * index + 2 * k, 2), nullptr, 16));
  return out;
}

/// Four bytes at a time: the same, or numbers to 1e-6.
bool alikeBytes(const std::string& a, const std::string& b) {
  if (a.size() != b.size() || a.size() % 8 != 0) return false;
  for (std::size_t i = 0; i < a.size() / 8; ++i) {
    const std::uint32_t x = word(a, i), y = word(b, i);
    float fx = 0, fy = 0;
    std::memcpy(&fx, &x, sizeof fx);
    std::memcpy(&fy, &y, sizeof fy);
    if (x != y && !(std::abs(fx) > 1e-6F && std::abs(fx - fy) <= 1e-6F * std::max(1.0F, std::abs(fx)))) return false;
  }
  return true;
}

TEST(SharedMessages, PageIsBuiltWithThePresentDescription) {
  if (writes()) std::ofstream(pathOf("src/protocol.json"), std::ios::binary) << protocolDescription();
  EXPECT_EQ(fileText("src/protocol.json"), protocolDescription());
}

TEST(SharedMessages, AreWrittenAsThePageIsTestedToReadThem) {
  const Json now = messages();
  if (writes()) std::ofstream(pathOf("test/messages.json"), std::ios::binary) << now.dump(1) << '\n';
  const Json file = Json::parse(fileText("test/messages.json"));
  EXPECT_EQ(file["session"], now["session"]);
  ASSERT_EQ(file["texts"].size(), now["texts"].size());
  for (std::size_t i = 0; i < now["texts"].size(); ++i) {
    const auto was = file["texts"][i].get<std::string>(), is = now["texts"][i].get<std::string>();
    EXPECT_TRUE(alike(Json::parse(was), Json::parse(is))) << is;
  }
  ASSERT_EQ(file["binary"].size(), now["binary"].size());
  for (std::size_t i = 0; i < now["binary"].size(); ++i) {
    const Json &was = file["binary"][i], &is = now["binary"][i];
    EXPECT_TRUE(alikeBytes(was["bytes"].get<std::string>(), is["bytes"].get<std::string>())) << is["fields"]["type"];
    EXPECT_TRUE(alike(was["fields"], is["fields"])) << is["fields"]["type"];
  }
}

// --- commands

template <class T>
void put(Json& json, const char* key, const std::optional<T>& value) {
  if (value) json[key] = *value;
}

Json arguments(const HandMessage& m) {
  const Vec3& p = m.pose.position;
  const Quat& q = m.pose.rotation;
  return {{"seq", m.sequence}, {"position", {p.x(), p.y(), p.z()}}, {"rotation", {q.w(), q.x(), q.y(), q.z()}}};
}
Json arguments(const SetMessage& m) {
  Json out = Json::object();
  put(out, "method", m.method);
  put(out, "handle", m.handle);
  put(out, "visual_step", m.visual_step);
  put(out, "friction", m.friction);
  put(out, "stiffness", m.stiffness);
  put(out, "speed", m.speed);
  put(out, "stress", m.stress);
  return out;
}
Json arguments(const SceneMessage& m) { return {{"name", m.name}}; }
Json arguments(const RecordMessage& m) { return {{"on", m.on}}; }
Json arguments(const PlaceMessage& m) {
  using Handle = PlaceMessage::Handle;
  const Quat& q = m.rotation;
  Json out{{"size", m.size}, {"rotation", {q.w(), q.x(), q.y(), q.z()}}, {"tetrahedra", m.tetrahedra}};
  out["handle"] = m.handle == Handle::top ? "top" : m.handle == Handle::box ? "box" : "painted";
  if (m.handle == Handle::box) {
    out["min"] = floatsOf(m.min);
    out["max"] = floatsOf(m.max);
  }
  if (m.handle == Handle::painted) {
    out["centers"] = flatPoints(m.centers);
    out["radius"] = m.radius;
  }
  return out;
}
template <class Message>
Json arguments(const Message&) {
  return Json::object();
}

TEST(SharedMessages, CommandsOfThePageAreUnderstood) {
  std::set<std::string> types, settings;
  std::set<std::size_t> kinds;
  for (const std::string text : Json::parse(fileText("test/commands.json"))) {
    Json sent = Json::parse(text);
    const auto type = sent["type"].get<std::string>();
    if (type == "ack") {
      EXPECT_EQ(acknowledgedStep(text), sent["frame"].get<unsigned>());
      continue;
    }
    const ViewerCommand command = parseCommand(text);
    types.insert(type);
    kinds.insert(command.index());
    sent.erase("type");
    EXPECT_TRUE(alike(std::visit([](const auto& m) { return arguments(m); }, command), sent)) << text;
    if (type != "set") continue;
    for (const auto& [key, value] : sent.items()) settings.insert(key);
  }
  const auto names = commandNames(), keys = settingNames();
  EXPECT_EQ(types, std::set<std::string>(names.begin(), names.end()));
  EXPECT_EQ(settings, std::set<std::string>(keys.begin(), keys.end()));
  EXPECT_EQ(kinds.size(), std::variant_size_v<ViewerCommand>);
}

}  // namespace
}  // namespace palpate
