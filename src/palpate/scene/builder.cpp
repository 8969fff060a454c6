#include "palpate/scene/builder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "palpate/common/cancellation.h"
#include "palpate/common/error.h"
#include "palpate/common/overloaded.h"
#include "palpate/devices/hardware_device.h"
#include "palpate/devices/prescribed_device.h"
#include "palpate/devices/recorded_device.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/alien.h"
#include "palpate/mesh/revolution.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/simplify_surface.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/mesh/tetrahedral_io.h"
#include "palpate/scene/limits.h"
#include "palpate/scene/method.h"
#include "palpate/scene/region.h"
#include "palpate/scene/text.h"
#include "palpate/threads/stage_teller.h"

namespace palpate {
namespace {

// Stands a surface on the origin: centered in x and y, its lowest point at z = 0.
void stand(std::vector<Vec3>& points) {
  Vec3 low = points.front();
  Vec3 high = points.front();
  for (const Vec3& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vec3 shift(-0.5 * (low.x() + high.x()), -0.5 * (low.y() + high.y()), -low.z());
  for (Vec3& p : points) p += shift;
}

Surface readSurfaceShape(const SurfaceShapeConfig& shape) {
  Surface surface = loadSolid(shape.file.path.string(), shape.size.value_or(0.0));
  for (Vec3& p : surface.vertices) {
    if (shape.up == AxisName::y) p = Vec3(p.x(), -p.z(), p.y());
    if (shape.up == AxisName::x) p = Vec3(p.y(), p.z(), p.x());
  }
  if (shape.size) stand(surface.vertices);
  return surface;
}

Surface standing(Surface surface) {
  stand(surface.vertices);
  return surface;
}

// The shapes that are surfaces, in rest coordinates.
Surface buildSurface(const ShapeConfig& shape) {
  return std::visit(Overloaded{[](const AlienShapeConfig& s) {
                                 return makeAlien({s.height, s.resolution}).surface;
                               },
                               [](const SurfaceShapeConfig& s) { return readSurfaceShape(s); },
                               [](const BoxShapeConfig& s) { return standing(boxSurface(s.size)); },
                               [](const SphereShapeConfig& s) { return standing(sphereSurface(s.radius)); },
                               [](const CapsuleShapeConfig& s) {
                                 return standing(capsuleSurface(s.radius, s.length - 2 * s.radius));
                               },
                               [](const RevolutionShapeConfig& s) { return revolutionSurface(s.profile, s.segments); },
                               [](const auto&) -> Surface { throw InputError("shape", "", "is not a surface"); }},
                    shape);
}

// Of a rigid body or obstacle: no lattice says how fine is fine enough.
Surface rigidSurface(const ShapeConfig& shape) {
  const auto* file = std::get_if<SurfaceShapeConfig>(&shape);
  if (!file || !file->tolerance) return buildSurface(shape);
  return simplifySurface(readSurfaceShape(*file), *file->tolerance).surface;
}

Surface placed(Surface surface, const Pose& pose) {
  for (Vec3& p : surface.vertices) p = pose.apply(p);
  return surface;
}

void place(SimulationMesh& mesh, const Pose& pose) {
  for (Vec3& p : mesh.mesh.nodes) p = pose.apply(p);
  for (Vec3& p : mesh.surface.vertices) p = pose.apply(p);
}

Handle buildHandle(const ToolConfig& tool, const SimulationMesh& rest, const BodyModel& body) {
  const HandleConfig& config = tool.chosenHandle();
  const RegionConfig region = resolvedRegion(config.region, tool.shape);
  const auto nodes = nodesWhere(rest.mesh.nodes, [&](const Vec3& p) { return contains(region, p); });
  // where none is in it, the message is to speak of the region's own coordinates
  const std::vector<Vec3>& positions = nodes.empty() ? rest.mesh.nodes : body.mesh().mesh.nodes;
  return handleOnNodes(config.name, nodes, positions, body.elasticity().mass(), config.mass,
                       config.inertia.value_or(Vec3::Zero()), tool.pose.rotation);
}

// Area of the surface that lies in a region, by the nodes that carry it [m^2]: each triangle counts by 16 places.
VecX areaInRegion(const SimulationMesh& rest, const RegionConfig& region) {
  constexpr int kParts = 4;  // of an edge
  VecX area = VecX::Zero(static_cast<Eigen::Index>(rest.mesh.nodes.size()));
  const auto share = [&](int vertex, double a) {
    const EmbeddedPoint& p = rest.embedding[vertex];
    double sum = 0;
    for (const double w : p.weights) sum += std::max(w, 0.0);
    for (int k = 0; k < 4; ++k) area[rest.mesh.tetrahedra[p.tetrahedron][k]] += a * std::max(p.weights[k], 0.0) / sum;
  };
  for (const auto& t : rest.surface.triangles) {
    const Vec3 &a = rest.surface.vertices[t[0]], &b = rest.surface.vertices[t[1]], &c = rest.surface.vertices[t[2]];
    const double part = 0.5 * (b - a).cross(c - a).norm() / (kParts * kParts);
    for (int i = 0; i < kParts; ++i) {
      for (int j = 0; i + j < kParts; ++j) {
        for (int upside = 0; upside < (i + j < kParts - 1 ? 2 : 1); ++upside) {
          const double u = (i + (1.0 + upside) / 3.0) / kParts, v = (j + (1.0 + upside) / 3.0) / kParts;
          if (!contains(region, a + u * (b - a) + v * (c - a))) continue;
          share(t[0], part * (1 - u - v));
          share(t[1], part * u);
          share(t[2], part * v);
        }
      }
    }
  }
  return area;
}

Path buildPath(const HandConfig& hand) {
  std::vector<PathKey> keys;
  for (const KeyframeConfig& k : hand.keyframes) keys.push_back({k.time, k.position, k.rotation});
  return Path(std::move(keys), hand.smooth ? Interpolation::smooth : Interpolation::linear, hand.wander);
}

Attachment buildAttachment(const AttachmentConfig& config, const BodyConfig& body, const SimulationMesh& rest) {
  const RegionConfig region = resolvedRegion(config.region, body.shape);
  Attachment out;
  out.name = config.name;
  if (!config.motion.keyframes.empty()) {
    out.motion = [path = buildPath(config.motion), period = config.period](double time) {
      return path.at(period > 0 ? std::fmod(std::max(time, 0.0), period) : time, Pose{}).pose;
    };
  }
  const auto fail = [&](const char* what) {
    const Bounds box = boundsOf(rest.surface.vertices);
    const auto text = [](const Vec3& v) { return fmt::format("({:.3g}, {:.3g}, {:.3g})", v.x(), v.y(), v.z()); };
    throw InputError(body.name + ": attachment " + config.name, "region",
                     fmt::format("holds {}, which lies from {} to {} m at rest", what, text(box.low), text(box.high)));
  };
  out.glued = !config.to.empty();
  if (!config.stiffness) {
    out.nodes = nodesWhere(rest.mesh.nodes, [&](const Vec3& p) { return contains(region, p); });
    if (out.nodes.empty()) fail("no node of the body's simulation mesh");
    return out;
  }
  const VecX area = areaInRegion(rest, region);
  for (Eigen::Index n = 0; n < area.size(); ++n) {
    if (area[n] > 0) out.nodes.push_back(static_cast<int>(n));
  }
  if (out.nodes.empty()) fail("no part of the body's surface");
  out.stiffness.resize(static_cast<Eigen::Index>(out.nodes.size()));
  for (std::size_t k = 0; k < out.nodes.size(); ++k) {
    out.stiffness[static_cast<Eigen::Index>(k)] = *config.stiffness * area[out.nodes[k]];
  }
  out.damping = out.stiffness * (config.damping / *config.stiffness);
  return out;
}

Obstacle buildObstacle(const ObstacleConfig& config) {
  Obstacle out;
  out.name = config.name;
  out.friction = config.friction;
  std::visit(
      Overloaded{[&](const PlaneObstacleConfig& s) {
                   out.shape = PlaneShape{s.point, s.normal};
                 },
                 [&](const BoxObstacleConfig& s) {
                   out.shape = BoxShape{s.pose, s.half_extents};
                 },
                 [&](const SphereObstacleConfig& s) {
                   out.shape = SphereShape{s.center, s.radius};
                 },
                 [&](const CapsuleObstacleConfig& s) {
                   out.shape = CapsuleShape{s.a, s.b, s.radius};
                 },
                 [&](const MeshObstacleConfig& m) { out.shape = MeshShape{placed(rigidSurface(m.shape), m.pose)}; }},
      config.geometry);
  return out;
}

std::unique_ptr<Device> buildDevice(const SceneConfig& config, Pose& start) {
  const DeviceConfig& d = config.device;
  if (isHardware(d.kind)) {
    if (!d.driver) throw InputError("device", toString(d.kind), "is only for palpate run and palpate view");
    return std::make_unique<HardwareDevice>(d.driver, workspaceSettings(d.options), start);
  }
  if (d.kind == DeviceName::recorded) {
    MotionRecording motion = readMotion(d.recording->path);
    auto device = std::make_unique<RecordedDevice>(std::move(motion), d.limits);
    start = device->sample(0.0).pose;
    return device;
  }
  Path path = buildPath(config.tool.chosenHandle().hand);
  if (d.kind == DeviceName::prescribed) return std::make_unique<PrescribedDevice>(std::move(path), start, d.limits);
  return std::make_unique<SimulatedDevice>(d, std::move(path), start);
}

HapticSettings buildHaptic(const SceneConfig& config, const World& world) {
  HapticSettings h;
  h.dt = config.haptic_step;
  h.rendering = renderingOf(config.method);
  h.link = world.link;
  const Handle& handle = world.tool().model.handle();
  h.proxy.mass = handle.mass;
  h.proxy.inertia = handle.inertia;
  h.proxy.gravity = config.gravity;
  if (config.weight_compensation) h.compensation = staticWeight(world);
  h.safety = safetyForDevice(config.safety.settings, config.device.limits);
  h.safety.model_age_limit =
      config.safety.model_age_limit.value_or(modelAgeLimit(config.visual_step, config.latency + config.jitter));
  return h;
}

}  // namespace

CompensatedWeight staticWeight(const World& world) {
  const Body tool = world.tool();
  const Handle& handle = tool.model.handle();
  const Pose& pose = tool.state.handle.pose;
  CompensatedWeight out;
  out.weight = tool.model.totalMass() * world.gravity;
  Vec3 moment = (handle.mass - handle.attached_mass) * pose.position;
  for (int i = 0; i < tool.model.nodes(); ++i) {
    moment += tool.model.elasticity().mass()[i] * tool.state.positions.segment<3>(3 * i);
  }
  out.center = pose.rotation.conjugate() * (moment / tool.model.totalMass() - pose.position);
  return out;
}

std::unique_ptr<MouseDevice> buildMouse(const SceneConfig& config, const Pose& start) {
  return std::make_unique<MouseDevice>(config.device, buildPath(config.tool.chosenHandle().hand), start);
}

SimulationMesh buildMesh(const BodyConfig& config, EmbedReport* report, std::vector<std::string>* notes) {
  if (const auto* bar = std::get_if<BarShapeConfig>(&config.shape)) {
    SimulationMesh mesh = barMesh(bar->size, bar->cells);
    const Vec3 shift(-0.5 * bar->size.x(), -0.5 * bar->size.y(), 0.0);
    place(mesh, {shift, Quat::Identity()});
    return mesh;
  }
  if (const auto* file = std::get_if<TetrahedraFileShapeConfig>(&config.shape)) {
    return simulationMeshOf(readTetrahedra(file->file.path.string(), notes), config.name);
  }
  EmbedOptions options;
  options.target_tetrahedra = config.tetrahedra;
  options.name = config.name;
  if (const auto* file = std::get_if<SurfaceShapeConfig>(&config.shape)) options.surface_tolerance = file->tolerance;
  return embedSurface(buildSurface(config.shape), options, report);
}

namespace {

// What a visual step may cost: no more than a hand can go without, but what a hard one needs. A fine step, as those of
// a reference, is not to be cut short [s].
double stepBudget(const SceneConfig& config) {
  return config.visual_budget.value_or(std::max(3.0 * config.visual_step, 0.02));
}

double frictionOf(const BodyConfig& body, const SceneConfig& config) {
  return body.friction.value_or(config.contact.friction);
}

void count(BuiltScene& out, const SimulationMesh& mesh) {
  out.tetrahedra += static_cast<int>(mesh.mesh.tetrahedra.size());
  out.nodes += static_cast<int>(mesh.mesh.nodes.size());
  out.surface_triangles += static_cast<int>(mesh.surface.triangles.size());
}

// Materials of a body's tetrahedra where it has parts; none otherwise.
std::vector<ElementMaterial> elementMaterials(const BodyConfig& body, const SimulationMesh& rest) {
  const MaterialConfig& own = body.material;
  if (own.parts.empty()) return {};
  std::vector<ElementMaterial> out;
  for (const int part : materialPartsOf(body, elementCentroids(rest.mesh))) {
    if (part < 0) {
      out.push_back({own.youngs_modulus, own.poisson_ratio, own.density});
    } else {
      out.push_back(own.parts[static_cast<std::size_t>(part)]);
    }
  }
  return out;
}

// Bodies by their place in the world, obstacles as FrictionTable counts them.
void setFrictionPairs(const SceneConfig& config, World& world) {
  const auto find = [&](const std::string& name) {
    for (std::size_t i = 0; i < config.obstacles.size(); ++i) {
      if (config.obstacles[i].name == name) return FrictionTable::obstacle(static_cast<int>(i));
    }
    for (std::size_t i = 0; i < config.bodies.size(); ++i) {
      if (config.bodies[i].name == name) return static_cast<int>(i) + 1;
    }
    return world.toolIndex();
  };
  for (const FrictionPairConfig& p : config.contact.pairs) world.setFriction(find(p.first), find(p.second), p.value);
}

// What bodies are glued to, by their names.
void glueBodies(const SceneConfig& config, World& world, std::vector<std::string>& notes) {
  std::vector<const BodyConfig*> bodies{&config.tool};
  for (const FreeBodyConfig& b : config.bodies) bodies.push_back(&b);
  std::vector<std::string> names;
  for (const BodyConfig* b : bodies) names.push_back(b->name);
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    for (std::size_t k = 0; k < bodies[i]->attachments.size(); ++k) {
      const AttachmentConfig& a = bodies[i]->attachments[k];
      if (a.to.empty()) continue;
      const auto at = std::find(names.begin(), names.end(), a.to);
      if (at == names.end()) {
        throw InputError(
            bodies[i]->name + ": attachment " + a.name, "to",
            fmt::format("there is no body {}; the nearest is \"{}\"", shownText(a.to), nearestWord(a.to, names)));
      }
      if (world.glue(static_cast<int>(i), static_cast<int>(k), static_cast<int>(at - names.begin()))) {
        notes.push_back(fmt::format("{} and {}, which {} glues, lie inside each other: they do not touch each other",
                                    bodies[i]->name, a.to, a.name));
      }
    }
  }
}

// What an embedded mesh is too coarse for.
void noteMesh(const BodyConfig& body, const EmbedReport& report, std::vector<std::string>& notes) {
  constexpr double kMuch = 0.3;  // of the surface
  if (report.thin_share > kMuch) {
    notes.push_back(
        fmt::format("{}: {:.0f} % of its surface has less than a cell of {:.2g} m under it, and is too stiff; about {} "
                    "tetrahedra would "
                    "carry it (palpate mesh stiffness says how much)",
                    body.name, 100 * report.thin_share, report.cell_size, report.suggested_tetrahedra));
  }
  if (report.seams > 0) {
    notes.push_back(fmt::format("{}: its surface may open at {} places that are too thin for {} tetrahedra", body.name,
                                report.seams, report.tetrahedra));
  }
}

void begin(StageTeller& teller, const std::string& stage) {
  throwIfCancelled();
  teller.at(stage);
}

World::SettleProgress tellSteps(StageTeller& teller, const std::string& what) {
  begin(teller, what + ": towards rest");
  return [&teller, what](int step, double displacement) {
    teller.at(fmt::format("{}: towards rest, step {}, moved {:.2g} mm", what, step, 1e3 * displacement));
  };
}

/// Counts the triangles of what does not deform, before contact is made ready for them.
class TriangleBudget {
 public:
  /// @param kind  "obstacle" or "body"
  void spend(const char* kind, const std::string& name, std::size_t triangles) {
    spent_ += triangles;
    if (spent_ <= limits::kFixedTriangles) return;
    throw InputError(fmt::format("{} {}", kind, name), "",
                     fmt::format("obstacles and rigid bodies have {} triangles up to this one, and may have at most {}",
                                 spent_, limits::kFixedTriangles));
  }
  void spend(const Obstacle& obstacle) {
    // the same for all of them, and slow to make
    static const std::size_t kSphere = surfaceOf({SphereShape{}, {}, {}})->triangles.size();
    if (std::holds_alternative<SphereShape>(obstacle.shape)) return spend("obstacle", obstacle.name, kSphere);
    if (const auto* mesh = std::get_if<MeshShape>(&obstacle.shape))
      return spend("obstacle", obstacle.name, mesh->surface.triangles.size());
    if (const auto surface = surfaceOf(obstacle)) spend("obstacle", obstacle.name, surface->triangles.size());
  }

 private:
  std::size_t spent_ = 0;
};

// One after the other with the rest held still, what is glued at once; together only if they lean on each other, as
// that takes far longer.
void settle(World& world, std::vector<int> bodies, const Pose& device, StageTeller& teller) {
  bool leaning = false;
  std::vector<int> done;
  for (auto i = bodies.rbegin(); i != bodies.rend(); ++i) {  // the tool last
    if (std::find(done.begin(), done.end(), *i) != done.end()) continue;
    const std::vector<int> together = world.gluedTogether(*i);
    done.insert(done.end(), together.begin(), together.end());
    world.settle(together, device, tellSteps(teller, world.body(*i).model.name()));
    const ContactSet& set = world.contacts();
    for (std::size_t c = 0; c < set.contacts.size(); ++c) {
      const Contact& contact = set.contacts[c];
      leaning |= !contact.glued() && set.status[c].state != ContactState::open && contact.second.body >= 0 &&
                 contact.second.body != contact.first.body;
    }
  }
  bodies = done;
  std::sort(bodies.begin(), bodies.end());
  if (leaning && bodies.size() > 1) world.settle(bodies, device, tellSteps(teller, "bodies together"));
}

// Where the scene does not say: what the device renders, and the tool's weight besides, which the link is to carry.
void limitLink(World& world, const DeviceLimits& limits) {
  const CompensatedWeight tool = staticWeight(world);
  const double weight = tool.weight.norm();
  const double torque = limits.peak_torque > 0 ? limits.peak_torque : DeviceLimits{}.peak_torque;
  if (!std::isfinite(world.link.peak_force)) world.link.peak_force = limits.peak_force + weight;
  if (!std::isfinite(world.link.peak_torque)) {
    world.link.peak_torque = torque + weight * tool.center.norm();
  }
}

BuiltScene buildChecked(const SceneConfig& config) {
  BuiltScene out;
  out.notes = config.device.notes;
  StageTeller teller;
  TriangleBudget budget;
  World& world = out.world;
  world.gravity = config.gravity;
  world.link = config.link;
  world.contact = config.contact.settings;
  world.budget = StepBudget::counted(stepBudget(config));
  for (const ObstacleConfig& o : config.obstacles) {
    begin(teller, o.name + ": reading its surface");
    world.obstacles.push_back(buildObstacle(o));
    budget.spend(world.obstacles.back());
  }

  const auto add = [&](const BodyConfig& b, const Vec6& velocity, bool tool) {
    EmbedReport report;
    begin(teller, b.name + ": making its mesh");
    const SimulationMesh rest = buildMesh(b, &report, &out.notes);
    SimulationMesh mesh = rest;
    place(mesh, b.pose);
    count(out, mesh);
    noteMesh(b, report, out.notes);
    begin(teller, fmt::format("{}: matrices of {} tetrahedra", b.name, rest.mesh.tetrahedra.size()));
    BodyModel body(b.name, std::move(mesh), b.material, frictionOf(b, config), velocity, elementMaterials(b, rest));
    for (const AttachmentConfig& a : b.attachments) body.attach(buildAttachment(a, b, rest));
    if (tool) {
      body.hold(buildHandle(config.tool, rest, body));
    }
    return world.add(std::move(body), b.self_contact);
  };
  const auto addRigid = [&](const BodyConfig& b, const Vec6& velocity, bool tool) {
    begin(teller, b.name + ": reading its surface");
    const Surface surface = placed(rigidSurface(b.shape), b.pose);
    budget.spend(tool ? "rigid" : "body", b.name, surface.triangles.size());
    out.surface_triangles += static_cast<int>(surface.triangles.size());
    BodyModel body = BodyModel::rigid(b.name, surface, b.material.density, frictionOf(b, config), velocity,
                                      b.material.damping_alpha);
    if (tool) {
      const HandleConfig& handle = config.tool.chosenHandle();
      body.holdRigid(handle.name, handle.mass, handle.inertia.value_or(Vec3::Zero()), b.pose.rotation);
    }
    world.add(std::move(body));
  };
  if (config.tool.rigid) {
    addRigid(config.tool, Vec6::Zero(), true);
  } else {
    add(config.tool, Vec6::Zero(), true);
  }
  limitLink(world, config.device.limits);
  out.start = world.tool().state.handle.pose;
  out.device = buildDevice(config, out.start);
  world.contact.thickness =
      config.contact.thickness.value_or(0.002 * boundsOf(world.tool().model.mesh().surface.vertices).diagonal());
  std::vector<int> settling;
  if (config.tool.settled) settling.push_back(world.toolIndex());
  for (const FreeBodyConfig& b : config.bodies) {
    Vec6 velocity;
    velocity << b.velocity, b.angular_velocity;
    if (b.rigid) {
      addRigid(b, velocity, false);
      continue;
    }
    const int index = add(b, velocity, false);
    if (b.settled) settling.push_back(index);
  }
  setFrictionPairs(config, world);
  glueBodies(config, world, out.notes);
  settle(world, settling, out.start, teller);
  out.linearization.delassus = delassusOf(config.method);
  out.linearization.derivative = config.derivative == DerivativeName::full ? Derivative::full : Derivative::frozen;
  out.haptic = buildHaptic(config, world);
  out.live = config.live;
  return out;
}

}  // namespace

BuiltScene buildScene(const SceneConfig& config) {
  try {
    return buildChecked(config);
  } catch (const InputError& e) {
    throw InputError(config.file.string(), "", e.what());
  } catch (const RunError& e) {  // what settles nowhere is the scene's fault
    throw InputError(config.file.string(), "", e.what());
  }
}

}  // namespace palpate
