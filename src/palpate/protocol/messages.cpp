#include "palpate/protocol/messages.h"

#include <algorithm>
#include <array>
#include <bit>
#include <nlohmann/json.hpp>

#include "palpate/contact/obstacle.h"
#include "palpate/fem/stress.h"
#include "palpate/haptics/coupling.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/protocol/byte_writer.h"
#include "palpate/protocol/layout.h"
#include "palpate/scene/checks.h"

namespace palpate {
namespace {

static_assert(std::endian::native == std::endian::little);

using Json = nlohmann::ordered_json;

using protocol::ObstacleKind;

template <class Kind>
std::uint32_t numberOf(Kind kind) {
  return static_cast<std::uint32_t>(kind);
}

Json toJson(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

// Text from files may hold bytes that are no UTF-8: they are replaced.
std::string dump(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

Json orNull(const std::string& text) { return text.empty() ? Json(nullptr) : Json(text); }

void writeBody(const World& world, int index, ByteWriter& out) {
  const Body body = world.body(index);
  const SimulationMesh& m = body.model.mesh();
  out.u32(m.mesh.nodes.size());
  out.u32(m.surface.vertices.size());
  out.u32(m.surface.triangles.size());
  out.u32(m.mesh.tetrahedra.size());
  out.u32((index == world.toolIndex() ? protocol::kToolBody : 0U) | (body.model.isRigid() ? protocol::kRigidBody : 0U));
  for (const Vec3& p : m.mesh.nodes) out.vec(p);
  for (const int attached : body.model.attachedIndex()) out.f32(body.model.held() && attached >= 0 ? 1.0 : 0.0);
  for (const auto& t : m.mesh.tetrahedra) {
    for (const int node : t) out.u32(node);
  }
  for (const EmbeddedPoint& p : m.embedding) {
    for (const int node : m.mesh.tetrahedra[p.tetrahedron]) out.u32(node);
  }
  for (const EmbeddedPoint& p : m.embedding) {
    for (const double w : p.weights) out.f32(w);
  }
  for (const auto& t : m.surface.triangles) {
    for (const int vertex : t) out.u32(vertex);
  }
}

void writeObstacle(const Obstacle& obstacle, ByteWriter& out) {
  if (const auto* plane = std::get_if<PlaneShape>(&obstacle.shape)) {
    out.u32(numberOf(ObstacleKind::plane));
    out.u32(0);
    out.u32(0);
    out.vec(plane->point);
    out.vec(plane->normal);
    return;
  }
  const Surface surface = surfaceOf(obstacle).value_or(Surface{});
  out.u32(numberOf(ObstacleKind::surface));
  out.u32(surface.vertices.size());
  out.u32(surface.triangles.size());
  for (const Vec3& p : surface.vertices) out.vec(p);
  for (const auto& t : surface.triangles) {
    for (const int vertex : t) out.u32(vertex);
  }
}

// Of the last part of a step, which has a length of its own, on the first body [N].
Vec3 contactForce(const World& world, std::size_t c) {
  const ContactSet& set = world.contacts();
  const Contact& contact = set.contacts[c];
  const double h = world.body(contact.first.body).system.input().step;
  return contact.frame().transpose() * set.impulse.segment<3>(3 * static_cast<Eigen::Index>(c)) / h;
}

float stateNumber(ContactState state) {
  const protocol::ContactKind kind = state == ContactState::open    ? protocol::ContactKind::open
                                     : state == ContactState::stick ? protocol::ContactKind::sticking
                                                                    : protocol::ContactKind::sliding;
  return static_cast<float>(kind);
}

Json attachmentsOf(const World& world, int body) {
  Json out = Json::array();
  for (const Attachment& a : world.body(body).model.attachments()) {
    out.push_back({{"name", a.name},
                   {"kind", a.fixed() ? "fixed"
                            : a.glued ? "glued"
                                      : "springs"},
                   {"nodes", a.nodes},
                   {"to", ""}});
  }
  for (const Joint& joint : world.joints()) {
    if (joint.body == body)
      out[static_cast<std::size_t>(joint.attachment)]["to"] = world.body(joint.partner).model.name();
  }
  return out;
}

}  // namespace

std::string sceneMessage(const SceneConfig& config, const BuiltScene& scene, const std::vector<SceneEntry>& scenes,
                         std::uint32_t generation) {
  Json out{{"type", "scene"},      {"generation", generation},          {"name", config.name},
           {"title", config.name}, {"description", config.description}, {"scenes", Json::array()}};
  for (const SceneEntry& s : scenes) out["scenes"].push_back({{"name", s.name}, {"description", s.description}});
  out["handles"] = Json::array();
  for (const HandleConfig& h : config.tool.handles) out["handles"].push_back(h.name);
  out["methods"] = methodNames();
  out["bodies"] = Json::array();
  for (int i = 0; i < scene.world.bodies(); ++i) {
    const Body body = scene.world.body(i);
    const char* kind = i == scene.world.toolIndex() ? "tool" : body.model.isRigid() ? "rigid" : "soft";
    out["bodies"].push_back({{"name", body.model.name()},
                             {"kind", kind},
                             {"attachments", attachmentsOf(scene.world, i)},
                             {"youngs_modulus", body.model.elasticity().material().youngs_modulus},
                             {"tetrahedra", body.model.mesh().mesh.tetrahedra.size()},
                             {"triangles", body.model.mesh().surface.triangles.size()}});
  }
  out["obstacles"] = Json::array();
  for (const Obstacle& o : scene.world.obstacles) out["obstacles"].push_back({{"name", o.name}});
  const DeviceLimits& limits = config.device.limits;
  out["device"] = {{"peak_force", limits.peak_force},
                   {"peak_torque", limits.peak_torque},
                   {"stiffness", scene.world.link.stiffness},
                   {"workspace_radius", limits.workspace_radius}};
  out["gravity"] = toJson(config.gravity);
  out["haptic_step"] = config.haptic_step;
  const Quat& r = scene.start.rotation;
  out["start"] = {{"position", toJson(scene.start.position)}, {"rotation", {r.w(), r.x(), r.y(), r.z()}}};
  return dump(out);
}

std::string stateMessage(const SceneConfig& config, const InteractiveSettings& settings,
                         const InteractiveStatus& status, std::uint32_t generation) {
  constexpr std::array kMotions{"none", "playing", "over"};
  Json out{{"type", "state"},
           {"generation", generation},
           {"handle", config.tool.handle},
           {"method", toString(config.method)},
           {"visual_step", config.visual_step},
           {"friction", settings.friction},
           {"stiffness", settings.stiffness},
           {"speed", settings.speed},
           {"paused", settings.paused},
           {"hand", nullptr},
           {"driver", status.on_path ? "path" : "hand"},
           {"stress", settings.stress},
           {"recording", orNull(status.recording)},
           {"busy", orNull(status.busy)},
           {"viewers", status.viewers},
           {"motion", kMotions[static_cast<std::size_t>(status.motion)]},
           {"placing", nullptr}};
  if (status.hand) out["hand"] = *status.hand;
  if (const auto& p = status.placing)
    out["placing"] = {{"name", p->name}, {"extent", toJson(p->extent)}, {"size", p->size}};
  return dump(out);
}

std::string noticeMessage(bool error, const std::string& text) {
  std::string line = text;
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c == '\n' || c == '\r'; }, ' ');
  return dump({{"type", "notice"}, {"level", error ? "error" : "info"}, {"text", line}});
}

std::string savedMessage(const std::string& name, const std::string& text) {
  return dump({{"type", "saved"}, {"name", name}, {"text", text}});
}

std::string statsMessage(const LoopFigures& figures, const PeriodicReport& report) {
  const auto histogram = [](const DurationHistogram& h) {
    Json bins = Json::array();
    for (const DurationHistogram::Bin& b : h.bins()) bins.push_back({b.upper, b.count});
    return Json{{"p50", h.percentile(0.5)}, {"p99", h.percentile(0.99)}, {"max", h.max()}, {"bins", bins}};
  };
  return dump({{"type", "stats"},
               {"ticks", figures.ticks},
               {"missed", figures.missed},
               {"dropped", figures.dropped},
               {"tick_us", histogram(report.work)},
               {"wake_us", histogram(report.wake_latency)},
               {"energy_J", figures.delivered_energy},
               {"realtime", orNull(figures.realtime_note)},
               {"server_share", figures.server_share}});
}

std::string geometryMessage(const World& world, std::uint32_t generation) {
  ByteWriter out;
  out.u32(numberOf(protocol::Kind::geometry));
  out.u32(generation);
  out.u32(world.bodies());
  out.u32(world.obstacles.size());
  for (int i = 0; i < world.bodies(); ++i) writeBody(world, i, out);
  for (const Obstacle& o : world.obstacles) writeObstacle(o, out);
  return out.take();
}

StateReader::StateReader(const World& world) {
  for (int i = 0; i < world.bodies(); ++i) {
    const SimulationMesh& m = world.body(i).model.mesh();
    std::vector<double> filled = resistingShares(m);
    for (std::size_t t = 0; t < m.mesh.tetrahedra.size(); ++t) {
      filled[t] *= tetrahedronVolume(m.mesh, m.mesh.tetrahedra[t]);
    }
    filled_.push_back(std::move(filled));
  }
}

void StateReader::read(const World& world, bool stress, SceneState& out) const {
  out.nodes.clear();
  for (int i = 0; i < world.bodies(); ++i) {
    const VecX& x = world.body(i).state.positions;
    for (Eigen::Index k = 0; k < x.size(); ++k) out.nodes.push_back(static_cast<float>(x[k]));
  }
  out.handle = world.tool().state.handle.pose;
  out.contacts.clear();
  const ContactSet& set = world.contacts();
  for (auto c = static_cast<std::size_t>(set.glued); c < set.contacts.size(); ++c) {
    const Contact& contact = set.contacts[c];
    const Vec3 force = contactForce(world, c);
    for (const Vec3& v : {contact.position, contact.normal, force}) {
      for (int k = 0; k < 3; ++k) out.contacts.push_back(static_cast<float>(v[k]));
    }
    out.contacts.push_back(stateNumber(set.status[c].state));
  }
  out.stress.clear();
  if (stress) readStress(world, out.stress);
}

std::string StateReader::materials(const World& world) const {
  ByteWriter out;
  out.u32(numberOf(protocol::ExtraKind::materials));
  for (int i = 0; i < world.bodies(); ++i) {
    const Body body = world.body(i);
    const std::vector<ElasticElement>& elements = body.model.elasticity().elements();
    const std::size_t count = body.model.isRigid() ? 0 : elements.size();
    out.u32(count);
    for (std::size_t t = 0; t < count; ++t) out.f32(elements[t].lambda / filled_[i][t]);
    for (std::size_t t = 0; t < count; ++t) out.f32(elements[t].mu / filled_[i][t]);
  }
  return out.take();
}

std::string stepExtra(const World& world) {
  ByteWriter out;
  out.u32(numberOf(protocol::ExtraKind::step));
  std::vector<int> first_node;
  int nodes = 0;
  for (int i = 0; i < world.bodies(); ++i) {
    out.f32(world.body(i).state.elastic.stiffness_scale);
    first_node.push_back(nodes);
    nodes += world.body(i).model.nodes();
  }
  const std::vector<Contact>& contacts = world.contacts().contacts;
  const auto glued = static_cast<std::size_t>(world.contacts().glued);  // come first, and are not recorded
  std::map<int, Vec3> forces;
  const auto spread = [&](const ContactPoint& point, const Vec3& force) {
    for (int k = 0; k < point.count && point.body >= 0; ++k) {
      forces.try_emplace(first_node[point.body] + point.node[k], Vec3::Zero()).first->second += point.weight[k] * force;
    }
  };
  out.u32(contacts.size() - glued);
  for (std::size_t c = glued; c < contacts.size(); ++c) {
    out.u32(static_cast<std::uint32_t>(contacts[c].first.body));
    out.u32(static_cast<std::uint32_t>(contacts[c].second.body));
    const Vec3 force = contactForce(world, c);
    spread(contacts[c].first, force);
    spread(contacts[c].second, -force);
  }
  out.u32(forces.size());
  for (const auto& [node, force] : forces) out.u32(node);
  for (const auto& [node, force] : forces) out.vec(force);
  return out.take();
}

// Cauchy stress of the corotational law in the rotated frame, whose von Mises measure is the same; averaged at nodes by
// volume.
void StateReader::readStress(const World& world, std::vector<float>& out) const {
  std::vector<double> sum, weight;
  for (int i = 0; i < world.bodies(); ++i) {
    const Body body = world.body(i);
    sum.assign(body.model.nodes(), 0.0);
    weight.assign(body.model.nodes(), 0.0);
    const std::vector<ElasticElement>& elements = body.model.elasticity().elements();
    const ElasticState& elastic = body.state.elastic;
    // those of the state's positions, where they are known; the state's own are of the start of the step
    const std::vector<Mat3>& rotations =
        body.system.ahead().isFor(body.state.positions) ? body.system.ahead().rotations : elastic.rotations;
    for (std::size_t t = 0; t < elements.size() && !body.model.isRigid(); ++t) {
      const ElasticElement& e = elements[t];
      const Mat3 g = rotations[t].transpose() * e.deformationGradient(body.state.positions);
      const double filled = filled_[i][t];
      const Mat3 unscaled = corotationalStress(g, e.lambda, e.mu) / filled;
      const Mat3 stress = elastic.stiffness_scale * unscaled;
      const double value = filled * vonMises(stress);
      for (const int node : e.node) {
        sum[node] += value;
        weight[node] += filled;
      }
    }
    for (std::size_t n = 0; n < sum.size(); ++n) {
      out.push_back(weight[n] > 0 ? static_cast<float>(sum[n] / weight[n]) : 0.0F);
    }
  }
}

std::string frameMessage(const SceneState& state, const TickRecord& tick, std::uint32_t hand_sequence,
                         std::uint32_t generation, bool nodes) {
  ByteWriter out(160 + (nodes ? 4 * (state.nodes.size() + state.stress.size() + state.contacts.size()) : 0));
  out.u32(numberOf(protocol::Kind::frame));
  out.u32(generation);
  out.u32(state.step);
  out.u32(hand_sequence);
  out.f64(tick.time);
  out.pose(tick.device.pose);
  out.pose(tick.proxy);
  out.pose(state.handle);
  out.vec(tick.sent);
  out.u32(tick.flags.bits());
  out.u32(nodes ? state.nodes.size() : 0);
  out.u32(nodes ? state.contacts.size() / protocol::stride(protocol::kContactColumns) : 0);
  out.u32(nodes ? state.stress.size() : 0);
  if (nodes) {
    out.f32s(state.nodes);
    out.f32s(state.stress);
    out.f32s(state.contacts);
  }
  return out.take();
}

void SampleEncoder::add(const VisualRecord& step, int substeps) {
  steps_.push_back({step, substeps});
  handles_.push_back({step.model.time, step.model.handle_pose, step.model.handle_twist});
  while (handles_.size() > 64) handles_.pop_front();
}

void SampleEncoder::add(const TickRecord& tick) {
  // the model that the tick used; before the first one, its proxy stands for the handle
  const double model_time = tick.time - tick.model_age;
  VisualHandle handle{model_time, tick.proxy, tick.proxy_twist};
  for (auto h = handles_.rbegin(); h != handles_.rend(); ++h) {
    if (h->time <= model_time + 1e-9) {
      handle = *h;
      break;
    }
  }
  ticks_.push_back({tick, couplingWrench(link_, handle.pose, handle.twist, tick.device)});
}

void SampleEncoder::writeTick(const TickRow& row, double origin, ByteWriter& out) const {
  out.f32(row.tick.time - origin);
  out.vec(row.tick.sent);
  out.vec(row.tick.raw);
  out.vec(row.coupling);
  out.u32(row.tick.flags.bits());
}

void SampleEncoder::writeStep(const StepRow& row, double origin, ByteWriter& out) const {
  const VisualRecord& r = row.step;
  const StepReport& s = r.step;
  Vec6 held = r.model.force;
  held.head<3>() += handle_weight_;
  out.f32(r.time - origin);
  out.vec(held);
  for (const double seconds : {s.times.total() + r.linearization_s, s.times.assemble, s.times.factorize, s.times.solve,
                               s.times.contact, s.times.advance, r.linearization_s, r.lateness_s}) {
    out.f32(1e3 * seconds);
  }
  for (const int n : {s.contacts_found, s.contacts, s.active, s.sticking, s.sliding, s.solver_iterations}) out.f32(n);
  for (const double v : {s.solver_residual, s.penetration, s.kinetic_energy, s.elastic_energy}) out.f32(v);
  out.f32(static_cast<int>(s.status));
  out.f32(row.substeps);
  out.f32(0);
}

std::string SampleEncoder::take() {
  ByteWriter out(40 + 4 * protocol::stride(protocol::kTickColumns) * ticks_.size() +
                 4 * protocol::stride(protocol::kStepColumns) * steps_.size());
  const double origin = !ticks_.empty() ? ticks_.front().tick.time : !steps_.empty() ? steps_.front().step.time : 0.0;
  out.u32(numberOf(protocol::Kind::samples));
  out.u32(generation_);
  out.u32(ticks_.size());
  out.u32(steps_.size());
  out.u32(0);  // lost; the server fills it in
  out.u32(0);
  out.f64(origin);
  for (const TickRow& row : ticks_) writeTick(row, origin, out);
  for (const StepRow& row : steps_) writeStep(row, origin, out);
  ticks_.clear();
  steps_.clear();
  return out.take();
}

}  // namespace palpate
