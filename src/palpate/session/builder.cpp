#include "palpate/session/builder.h"

#include <algorithm>
#include <map>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/devices/prescribed_device.h"
#include "palpate/devices/recorded_device.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/coupling.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/alien.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/tetrahedral_io.h"

namespace palpate {
namespace {

template <typename... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <typename... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

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

SimulationMesh embed(const BodyConfig& config, const Surface& surface, EmbedReport* report) {
  EmbedOptions options;
  options.target_tetrahedra = config.tetrahedra;
  options.name = config.name;
  return embedSurface(surface, options, report);
}

Surface standing(Surface surface) {
  stand(surface.vertices);
  return surface;
}

void place(SimulationMesh& mesh, const Pose& pose) {
  for (Vec3& p : mesh.mesh.nodes) p = pose.apply(p);
  for (Vec3& p : mesh.surface.vertices) p = pose.apply(p);
}

Vec3 landmark(const ToolConfig& tool, const std::string& name) {
  const auto* alien = std::get_if<AlienShapeConfig>(&tool.shape);
  if (alien == nullptr) throw InputError(tool.name, "region.landmark", "only the alien has landmarks");
  const AlienLandmarks l = makeAlien({alien->height, alien->resolution}).landmarks;
  const std::map<std::string, Vec3> places{{"head", l.head},           {"trunk", l.trunk},
                                           {"left_hand", l.left_hand}, {"right_hand", l.right_hand},
                                           {"left_foot", l.left_foot}, {"right_foot", l.right_foot}};
  const auto at = places.find(name);
  if (at == places.end()) throw InputError(tool.name, "region.landmark", "no landmark is called '" + name + "'");
  return at->second;
}

bool inBall(const Vec3& x, const Vec3& center, double radius) { return (x - center).norm() <= radius; }

bool inCapsule(const Vec3& x, const CapsuleRegionConfig& c) {
  const Vec3 axis = c.b - c.a;
  const double t = axis.squaredNorm() > 0 ? std::clamp((x - c.a).dot(axis) / axis.squaredNorm(), 0.0, 1.0) : 0.0;
  return inBall(x, c.a + t * axis, c.radius);
}

Handle buildHandle(const ToolConfig& tool, const SimulationMesh& rest, const Body& body) {
  const HandleConfig& config = tool.chosenHandle();
  Vec3 center = Vec3::Zero();
  if (const auto* l = std::get_if<LandmarkRegionConfig>(&config.region)) center = landmark(tool, l->landmark);
  std::vector<int> nodes;
  std::vector<Vec3> positions;
  std::vector<double> masses;
  for (int i = 0; i < body.nodes(); ++i) {
    const Vec3& x = rest.mesh.nodes[i];
    const bool inside =
        std::visit(Overloaded{[&](const SphereRegionConfig& r) { return inBall(x, r.center, r.radius); },
                              [&](const BoxRegionConfig& r) {
                                return (x.array() >= r.min.array()).all() && (x.array() <= r.max.array()).all();
                              },
                              [&](const CapsuleRegionConfig& r) { return inCapsule(x, r); },
                              [&](const HalfspaceRegionConfig& r) { return r.normal.dot(x - r.point) >= 0; },
                              [&](const LandmarkRegionConfig& r) { return inBall(x, center, r.radius); }},
                   config.region);
    if (!inside) continue;
    nodes.push_back(i);
    positions.push_back(body.positions().segment<3>(3 * i));
    masses.push_back(body.elasticity().mass()[i]);
  }
  return makeHandle(config.name, nodes, positions, masses, config.mass, config.inertia.value_or(Vec3::Zero()),
                    tool.pose.rotation);
}

Material buildMaterial(const MaterialConfig& m) {
  return {m.youngs_modulus, m.poisson_ratio, m.density, m.damping_alpha, m.damping_beta};
}

Obstacle buildObstacle(const ObstacleConfig& config) {
  Obstacle out;
  out.name = config.name;
  out.friction = config.friction;
  std::visit(Overloaded{[&](const PlaneObstacleConfig& s) {
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
                        }},
             config.geometry);
  return out;
}

Path buildPath(const HandConfig& hand) {
  std::vector<PathKey> keys;
  for (const KeyframeConfig& k : hand.keyframes) keys.push_back({k.time, k.position, k.rotation});
  return Path(std::move(keys), hand.smooth ? Interpolation::smooth : Interpolation::linear);
}

std::unique_ptr<Device> buildDevice(const SceneConfig& config, Pose& start) {
  const DeviceConfig& d = config.device;
  if (d.kind == DeviceName::recorded) {
    MotionRecording motion = readMotion(d.recording->path);
    auto device = std::make_unique<RecordedDevice>(std::move(motion), d.limits);
    start = device->sample(0.0).pose;
    return device;
  }
  Path path = buildPath(config.tool.chosenHandle().hand);
  if (d.kind == DeviceName::prescribed) return std::make_unique<PrescribedDevice>(std::move(path), start, d.limits);
  SimulatedDeviceSettings s;
  const auto set = [](double& value, const std::optional<double>& given) { value = given.value_or(value); };
  set(s.mass, d.mass);
  set(s.inertia, d.inertia);
  set(s.damping, d.damping);
  set(s.rotational_damping, d.rotational_damping);
  set(s.hand_stiffness, d.hand_stiffness);
  set(s.hand_damping, d.hand_damping);
  set(s.hand_rotational_stiffness, d.hand_rotational_stiffness);
  set(s.hand_rotational_damping, d.hand_rotational_damping);
  s.limits = d.limits;
  return std::make_unique<SimulatedDevice>(s, std::move(path), start);
}

HapticSettings buildHaptic(const SceneConfig& config, const World& world) {
  HapticSettings h;
  h.dt = config.haptic_step;
  h.rendering = config.method == MethodName::vc ? Rendering::visual_coupling : Rendering::linearized;
  h.link = world.link;
  const Handle& handle = world.tool().handle();
  h.proxy.mass = handle.mass;
  h.proxy.inertia = handle.inertia;
  h.proxy.gravity = config.gravity;
  if (config.weight_compensation) h.compensation = staticWeight(world);
  h.safety = safetyForDevice(config.device.limits);
  h.safety.model_age_limit = config.safety.model_age_limit.value_or(modelAgeLimit(config.visual_step, config.latency));
  if (config.safety.max_slew) h.safety.force_slew = *config.safety.max_slew;
  if (config.safety.start_ramp) h.safety.start_ramp = *config.safety.start_ramp;
  return h;
}

}  // namespace

CompensatedWeight staticWeight(const World& world) {
  const Body& tool = world.tool();
  const Handle& handle = tool.handle();
  CompensatedWeight out;
  out.weight = tool.totalMass() * world.gravity;
  Vec3 moment = (handle.mass - handle.attached_mass) * handle.pose.position;
  for (int i = 0; i < tool.nodes(); ++i) moment += tool.elasticity().mass()[i] * tool.positions().segment<3>(3 * i);
  out.center = handle.pose.rotation.conjugate() * (moment / tool.totalMass() - handle.pose.position);
  return out;
}

SimulationMesh buildMesh(const BodyConfig& config, EmbedReport* report) {
  return std::visit(
      Overloaded{[&](const AlienShapeConfig& s) {
                   return embed(config, makeAlien({s.height, s.resolution}).surface, report);
                 },
                 [&](const SurfaceShapeConfig& s) { return embed(config, readSurfaceShape(s), report); },
                 [&](const BarShapeConfig& s) {
                   SimulationMesh mesh = barMesh(s.size, s.cells);
                   const Vec3 shift(-0.5 * s.size.x(), -0.5 * s.size.y(), 0.0);
                   place(mesh, {shift, Quat::Identity()});
                   return mesh;
                 },
                 [&](const BoxShapeConfig& s) { return embed(config, standing(boxSurface(s.size)), report); },
                 [&](const SphereShapeConfig& s) { return embed(config, standing(sphereSurface(s.radius)), report); },
                 [&](const CapsuleShapeConfig& s) {
                   return embed(config, standing(capsuleSurface(s.radius, s.length - 2 * s.radius)), report);
                 },
                 [&](const TetrahedraFileShapeConfig& s) {
                   return simulationMeshOf(readTetrahedra(s.file.path.string()), config.name);
                 }},
      config.shape);
}

namespace {

BuiltScene buildChecked(const SceneConfig& config) {
  BuiltScene out;
  World& world = out.world;
  world.gravity = config.gravity;
  const LinkParameters allowed = linkForDevice(config.device.limits);
  world.link = {config.link.stiffness.value_or(allowed.stiffness), config.link.damping.value_or(allowed.damping),
                config.link.rotational_stiffness.value_or(allowed.rotational_stiffness),
                config.link.rotational_damping.value_or(allowed.rotational_damping)};
  world.contact.cone = config.contact.cone;
  world.contact.penetration_tolerance = config.contact.penetration_tolerance;
  world.contact.reach = config.contact.margin;
  world.contact.max_passes = config.contact.max_passes;
  world.contact.reduce = config.contact.reduction;
  world.contact.solver = config.contact.solver;
  for (const ObstacleConfig& o : config.obstacles) world.obstacles.push_back(buildObstacle(o));

  const auto add = [&](const BodyConfig& b, const Vec6& velocity, bool tool) {
    EmbedReport report;
    const SimulationMesh rest = buildMesh(b, &report);
    SimulationMesh placed = rest;
    place(placed, b.pose);
    out.tetrahedra += static_cast<int>(rest.mesh.tetrahedra.size());
    out.nodes += static_cast<int>(rest.mesh.nodes.size());
    out.surface_triangles += static_cast<int>(rest.surface.triangles.size());
    Body body(b.name, std::move(placed), buildMaterial(b.material), b.friction.value_or(config.contact.friction),
              velocity);
    if (tool) {
      if (report.tetrahedra > 0) out.embedding = report;
      body.hold(buildHandle(config.tool, rest, body));
    }
    return world.add(std::move(body));
  };
  add(config.tool, Vec6::Zero(), true);
  out.start = world.tool().handle().pose;
  out.device = buildDevice(config, out.start);
  world.settle(0, out.start);
  for (const FreeBodyConfig& b : config.bodies) {
    Vec6 velocity;
    velocity << b.velocity, b.angular_velocity;
    const int index = add(b, velocity, false);
    if (b.settled) world.settle(index, Pose{});
  }
  out.linearization.delassus = config.method == MethodName::hsl_exact ? DelassusModel::exact : DelassusModel::diagonal;
  out.linearization.derivative = config.derivative == DerivativeName::full ? Derivative::full : Derivative::frozen;
  out.haptic = buildHaptic(config, world);
  return out;
}

}  // namespace

BuiltScene buildScene(const SceneConfig& config) {
  try {
    return buildChecked(config);
  } catch (const InputError& e) {
    throw InputError(config.file.string(), "", e.what());
  }
}

}  // namespace palpate
