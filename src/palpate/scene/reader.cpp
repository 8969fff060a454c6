#include "palpate/scene/reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <set>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/limits.h"
#include "palpate/scene/value.h"

namespace palpate {
namespace {

constexpr int schema_version = 1;
constexpr std::size_t max_bodies = 100;
constexpr std::size_t max_obstacles = 1000;
constexpr std::size_t max_handles = 50;
constexpr std::size_t max_keyframes = 10000;

const Range coordinate = Range::within(-100.0, 100.0, "m");
const Range size = Range::within(1e-4, 10.0, "m");
const Range friction_coefficient = Range::within(0.0, 10.0, "");

// Small parts
// ----------------------------------------------------------------------------------------------------------

Field rotationField(const char* key, Vec3& target, double max_degrees) {
  return {key, [&target, max_degrees](const Value& value) { target = value.rotation(max_degrees); }};
}

Field frictionField(std::optional<double>& target) { return numberField("friction", target, friction_coefficient); }

Field nameField(std::string& target) {
  return {"name", [&target](const Value& value) { target = value.name(); }};
}

template <typename Enum>
Field choiceField(const char* key, Enum& target, const std::vector<std::string>& words) {
  return {key, [&target, &words](const Value& value) { target = static_cast<Enum>(value.choice(words)); }};
}

Field poseField(const char* key, Pose& pose) {
  return {
      key, [&pose](const Value& value) {
        Vec3 rotation = Vec3::Zero();
        value.fields({vectorField("position", pose.position, coordinate), rotationField("rotation", rotation, 3600.0)});
        pose.rotation = expRotation(rotation);
      }};
}

std::string readFileName(const Value& value) {
  std::string name = value.text(4000);
  if (name.empty()) value.fail("is empty; a file name is needed");
  return name;
}

/// A package name leads to a folder, so it must not lead anywhere else.
std::string readPackageName(const Value& value) {
  std::string name = value.name();
  if (name.front() == '.') value.fail(fmt::format("{} is not a package name", shownText(name)));
  return name;
}

void checkPackageFile(const Value& value, const FileReference& reference) {
  if (reference.package.empty()) return;
  const std::filesystem::path path(reference.file);
  if (path.is_absolute() || std::find(path.begin(), path.end(), "..") != path.end())
    value.fail("with a package, file is relative to the package's data folder and has no ..");
}

// Shapes
// ---------------------------------------------------------------------------------------------------------------

AlienShapeConfig readAlien(const Value& value) {
  AlienShapeConfig shape;
  value.fields({numberField("height", shape.height, Range::within(0.01, 2.0, "m")),
                numberField("resolution", shape.resolution, Range::within(0.005, 0.04, "heights"))});
  return shape;
}

SurfaceShapeConfig readSurface(const Value& value) {
  static const std::vector<std::string> axes{"x", "y", "z"};
  SurfaceShapeConfig shape;
  FileReference& file = shape.file;
  value.fields({required({"file", [&](const Value& v) { file.file = readFileName(v); }}),
                {"package", [&](const Value& v) { file.package = readPackageName(v); }},
                numberField("size", shape.size, size),
                choiceField("up", shape.up, axes)});
  checkPackageFile(value, file);
  return shape;
}

BarShapeConfig readBar(const Value& value) {
  BarShapeConfig shape;
  const auto readCells = [&](const Value& cells) {
    const std::vector<Value> parts = cells.items(3);
    if (parts.size() != 3) cells.fail(fmt::format("has {} numbers; it must have 3", parts.size()));
    for (std::size_t i = 0; i < 3; ++i) shape.cells[i] = parts[i].integer(1, 200);
  };
  value.fields({required(vectorField("size", shape.size, size)), required({"cells", readCells})});
  return shape;
}

BoxShapeConfig readBox(const Value& value) {
  BoxShapeConfig shape;
  value.fields({required(vectorField("size", shape.size, size))});
  return shape;
}

SphereShapeConfig readSphere(const Value& value) {
  SphereShapeConfig shape;
  value.fields({required(numberField("radius", shape.radius, size))});
  return shape;
}

CapsuleShapeConfig readCapsule(const Value& value) {
  CapsuleShapeConfig shape;
  value.fields(
      {required(numberField("radius", shape.radius, size)), required(numberField("length", shape.length, size))});
  if (shape.length < 2.0 * shape.radius) value.fail("length, from tip to tip, must be at least twice the radius");
  return shape;
}

TetrahedraFileShapeConfig readTetrahedraFile(const Value& value) {
  TetrahedraFileShapeConfig shape;
  shape.file.file = readFileName(value);
  return shape;
}

Field shapeField(ShapeConfig& shape) {
  const auto field = [&shape](const char* key, auto read) {
    return Field{key, [&shape, read](const Value& value) { shape = read(value); }};
  };
  const std::vector<Field> choices{field("alien", readAlien),
                                   field("surface", readSurface),
                                   field("bar", readBar),
                                   field("box", readBox),
                                   field("sphere", readSphere),
                                   field("capsule", readCapsule),
                                   field("tetrahedra_file", readTetrahedraFile)};
  return required({"shape", [choices](const Value& value) { value.oneOf(choices); }});
}

// Bodies
// ---------------------------------------------------------------------------------------------------------------

Field materialField(MaterialConfig& material) {
  return {"material", [&material](const Value& value) {
            value.fields({numberField("youngs_modulus", material.youngs_modulus, Range::positive(1e12, "Pa")),
                          numberField("poisson_ratio", material.poisson_ratio, Range::between(-1.0, 0.5, "")),
                          numberField("density", material.density, Range::positive(1e5, "kg/m^3")),
                          numberField("damping_alpha", material.damping_alpha, Range::within(0.0, 1e4, "1/s")),
                          numberField("damping_beta", material.damping_beta, Range::within(0.0, 10.0, "s"))});
          }};
}

/// A shape with nodes of its own has no use for a wanted count.
bool hasOwnTetrahedra(const ShapeConfig& shape) {
  return std::holds_alternative<BarShapeConfig>(shape) || std::holds_alternative<TetrahedraFileShapeConfig>(shape);
}

/// The fields that tool and bodies share. The shape comes first: what follows may depend on it.
std::vector<Field> bodyFields(BodyConfig& body) {
  const auto readTetrahedra = [&body](const Value& value) {
    if (hasOwnTetrahedra(body.shape))
      value.fail("this shape has tetrahedra of its own; only embedded surfaces take a count");
    body.tetrahedra = value.integer(limits::min_tetrahedra, limits::tetrahedra);
  };
  return {shapeField(body.shape),
          {"tetrahedra", readTetrahedra},
          poseField("pose", body.pose),
          materialField(body.material),
          frictionField(body.friction)};
}

FreeBodyConfig readFreeBody(const Value& value, std::size_t index) {
  static const std::vector<std::string> starts{"rest", "settled"};
  FreeBodyConfig body;
  body.name = fmt::format("body-{}", index + 1);
  std::vector<Field> fields = bodyFields(body);
  fields.push_back(nameField(body.name));
  fields.push_back(vectorField("velocity", body.velocity, Range::within(-100.0, 100.0, "m/s")));
  fields.push_back(rotationField("angular_velocity", body.angular_velocity, 36000.0));
  fields.push_back({"start", [&body](const Value& v) { body.settled = v.choice(starts) == 1; }});
  value.fields(fields);
  return body;
}

// Handles
// --------------------------------------------------------------------------------------------------------------

SphereRegionConfig readSphereRegion(const Value& value) {
  SphereRegionConfig region;
  value.fields({required(vectorField("center", region.center, coordinate)),
                required(numberField("radius", region.radius, size))});
  return region;
}

BoxRegionConfig readBoxRegion(const Value& value) {
  BoxRegionConfig region;
  value.fields(
      {required(vectorField("min", region.min, coordinate)), required(vectorField("max", region.max, coordinate))});
  if ((region.min.array() > region.max.array()).any()) value.fail("min must not be above max");
  return region;
}

CapsuleRegionConfig readCapsuleRegion(const Value& value) {
  CapsuleRegionConfig region;
  value.fields({required(vectorField("a", region.a, coordinate)), required(vectorField("b", region.b, coordinate)),
                required(numberField("radius", region.radius, size))});
  return region;
}

HalfspaceRegionConfig readHalfspaceRegion(const Value& value) {
  HalfspaceRegionConfig region;
  value.fields(
      {required(vectorField("point", region.point, coordinate)), required(directionField("normal", region.normal))});
  return region;
}

LandmarkRegionConfig readLandmarkRegion(const Value& value) {
  LandmarkRegionConfig region;
  const auto readName = [&](const Value& name) {
    region.landmark = alienLandmarkNames().at(name.choice(alienLandmarkNames()));
  };
  value.fields({required({"name", readName}), required(numberField("radius", region.radius, size))});
  return region;
}

Field regionField(RegionConfig& region, const ShapeConfig& shape) {
  const auto field = [&region](const char* key, auto read) {
    return Field{key, [&region, read](const Value& value) { region = read(value); }};
  };
  const auto readLandmark = [&shape](const Value& value) {
    if (!std::holds_alternative<AlienShapeConfig>(shape)) value.fail("only the shape alien has landmarks");
    return readLandmarkRegion(value);
  };
  const std::vector<Field> choices{field("sphere", readSphereRegion), field("box", readBoxRegion),
                                   field("capsule", readCapsuleRegion), field("halfspace", readHalfspaceRegion),
                                   field("landmark", readLandmark)};
  return required({"region", [choices](const Value& value) { value.oneOf(choices); }});
}

KeyframeConfig readKeyframe(const Value& value) {
  KeyframeConfig keyframe;
  value.fields({required(numberField("t", keyframe.time, Range::within(0.0, 3600.0, "s"))),
                vectorField("position", keyframe.position, Range::within(-10.0, 10.0, "m")),
                rotationField("rotation", keyframe.rotation, 360.0)});
  return keyframe;
}

HandConfig readHand(const Value& value) {
  HandConfig hand;
  const auto readKeyframes = [&](const Value& list) {
    for (const Value& item : list.items(max_keyframes)) {
      hand.keyframes.push_back(readKeyframe(item));
      const std::size_t count = hand.keyframes.size();
      if (count > 1 && hand.keyframes[count - 1].time <= hand.keyframes[count - 2].time)
        item.fail(fmt::format("t = {:g} s is not later than the keyframe before, {:g} s",
                              hand.keyframes[count - 1].time, hand.keyframes[count - 2].time));
    }
  };
  value.fields({{"keyframes", readKeyframes}, booleanField("smooth", hand.smooth)});
  return hand;
}

/// Principal moments of a body that can exist: no one exceeds the sum of the other two.
Vec3 readInertia(const Value& value) {
  const Vec3 inertia = value.vector(Range::positive(100.0, "kg m^2"));
  if (2.0 * inertia.maxCoeff() > inertia.sum() * (1.0 + 1e-9))
    value.fail("one moment exceeds the sum of the other two");
  return inertia;
}

HandleConfig readHandle(const Value& value, const std::string& name, const ShapeConfig& shape) {
  HandleConfig handle;
  handle.name = name;
  value.fields({regionField(handle.region, shape),
                numberField("mass", handle.mass, Range::positive(100.0, "kg")),
                {"inertia", [&](const Value& v) { handle.inertia = readInertia(v); }},
                {"hand", [&](const Value& v) { handle.hand = readHand(v); }}});
  return handle;
}

void readTool(const Value& value, ToolConfig& tool) {
  tool.name = "tool";
  const auto readHandles = [&](const Value& handles) {
    for (const auto& [name, handle] : handles.namedEntries(max_handles))
      tool.handles.push_back(readHandle(handle, name, tool.shape));
    if (tool.handles.empty()) handles.fail("is empty; the tool needs at least one handle");
    tool.handle = tool.handles.front().name;
  };
  const auto chooseHandle = [&](const Value& handle) {
    tool.handle = handle.name();
    if (const auto cause = handleObjection(tool, tool.handle)) handle.fail(*cause);
  };
  std::vector<Field> fields = bodyFields(tool);
  fields.push_back(required({"handles", readHandles}));
  fields.push_back({"handle", chooseHandle});
  value.fields(fields);
}

// Obstacles
// ------------------------------------------------------------------------------------------------------------

PlaneObstacleConfig readPlane(const Value& value) {
  PlaneObstacleConfig plane;
  value.fields({vectorField("point", plane.point, coordinate), directionField("normal", plane.normal)});
  return plane;
}

BoxObstacleConfig readBoxObstacle(const Value& value) {
  BoxObstacleConfig box;
  Vec3 rotation = Vec3::Zero();
  value.fields({required(vectorField("center", box.pose.position, coordinate)),
                required(vectorField("half_extents", box.half_extents, size)),
                rotationField("rotation", rotation, 3600.0)});
  box.pose.rotation = expRotation(rotation);
  return box;
}

SphereObstacleConfig readSphereObstacle(const Value& value) {
  SphereObstacleConfig sphere;
  value.fields({required(vectorField("center", sphere.center, coordinate)),
                required(numberField("radius", sphere.radius, size))});
  return sphere;
}

CapsuleObstacleConfig readCapsuleObstacle(const Value& value) {
  CapsuleObstacleConfig capsule;
  value.fields({required(vectorField("a", capsule.a, coordinate)), required(vectorField("b", capsule.b, coordinate)),
                required(numberField("radius", capsule.radius, size))});
  return capsule;
}

ObstacleConfig readObstacle(const Value& value, std::size_t index) {
  ObstacleConfig obstacle;
  obstacle.name = fmt::format("obstacle-{}", index + 1);
  const auto field = [&obstacle](const char* key, auto read) {
    return Field{key, [&obstacle, read](const Value& v) { obstacle.geometry = read(v); }};
  };
  value.oneOf({field("plane", readPlane), field("box", readBoxObstacle), field("sphere", readSphereObstacle),
               field("capsule", readCapsuleObstacle)},
              {nameField(obstacle.name), frictionField(obstacle.friction)});
  return obstacle;
}

// Contact, link, device, safety
// ----------------------------------------------------------------------------------------

void readContact(const Value& value, ContactConfig& contact) {
  const auto readSolver = [&](const Value& solver) {
    solver.fields({integerField("max_iterations", contact.solver.max_iterations, 1, 1000000),
                   numberField("tolerance", contact.solver.tolerance, Range::between(0.0, 1.0, ""))});
  };
  value.fields({{"cone", [&](const Value& v) { contact.cone.exact = v.choice(coneNames()) == 1; }},
                integerField("facets", contact.cone.facets, 3, 64),
                numberField("friction", contact.friction, friction_coefficient),
                numberField("margin", contact.margin, Range::positive(1.0, "m")),
                numberField("penetration_tolerance", contact.penetration_tolerance, Range::positive(0.01, "m")),
                integerField("max_passes", contact.max_passes, 1, 100),
                booleanField("reduction", contact.reduction),
                {"solver", readSolver}});
}

void readLink(const Value& value, LinkConfig& link) {
  value.fields({numberField("stiffness", link.stiffness, Range::positive(1e6, "N/m")),
                numberField("damping", link.damping, Range::within(0.0, 1e4, "N s/m")),
                numberField("rotational_stiffness", link.rotational_stiffness, Range::positive(1e4, "N m/rad")),
                numberField("rotational_damping", link.rotational_damping, Range::within(0.0, 100.0, "N m s/rad"))});
}

void readLimits(const Value& value, DeviceLimits& limits) {
  value.fields({numberField("peak_force", limits.peak_force, Range::positive(1000.0, "N")),
                numberField("continuous_force", limits.continuous_force, Range::positive(1000.0, "N")),
                numberField("peak_torque", limits.peak_torque, Range::within(0.0, 100.0, "N m")),
                numberField("stiffness", limits.stiffness, Range::positive(1e6, "N/m")),
                numberField("damping", limits.damping, Range::within(0.0, 1e4, "N s/m")),
                numberField("rotational_stiffness", limits.rotational_stiffness, Range::positive(1e4, "N m/rad")),
                numberField("rotational_damping", limits.rotational_damping, Range::within(0.0, 100.0, "N m s/rad")),
                numberField("workspace_radius", limits.workspace_radius, Range::positive(10.0, "m"))});
  if (limits.continuous_force > limits.peak_force)
    value.fail(
        fmt::format("continuous_force {:g} N is above peak_force {:g} N", limits.continuous_force, limits.peak_force));
}

void readDevice(const Value& value, DeviceConfig& device) {
  value.fields(
      {choiceField("type", device.kind, deviceNames()),
       {"file",
        [&](const Value& v) {
          device.recording = FileReference{readFileName(v), "", {}};
        }},
       numberField("mass", device.mass, Range::positive(100.0, "kg")),
       numberField("inertia", device.inertia, Range::positive(100.0, "kg m^2")),
       numberField("damping", device.damping, Range::within(0.0, 1e4, "N s/m")),
       numberField("rotational_damping", device.rotational_damping, Range::within(0.0, 100.0, "N m s/rad")),
       numberField("hand_stiffness", device.hand_stiffness, Range::within(0.0, 1e6, "N/m")),
       numberField("hand_damping", device.hand_damping, Range::within(0.0, 1e4, "N s/m")),
       numberField("hand_rotational_stiffness", device.hand_rotational_stiffness, Range::within(0.0, 1e4, "N m/rad")),
       numberField("hand_rotational_damping", device.hand_rotational_damping, Range::within(0.0, 100.0, "N m s/rad")),
       {"limits", [&](const Value& v) { readLimits(v, device.limits); }}});
  const bool recorded = device.kind == DeviceName::recorded;
  if (recorded && !device.recording) value.fail("a recorded device needs a file");
  if (!recorded && device.recording) value.fail("only a recorded device has a file");
}

void readSafety(const Value& value, SafetyConfig& safety) {
  value.fields({numberField("max_slew", safety.max_slew, Range::positive(1e7, "N/s")),
                numberField("start_ramp", safety.start_ramp, Range::within(0.0, 10.0, "s")),
                numberField("model_age_limit", safety.model_age_limit, Range::positive(10.0, "s"))});
}

// The scene
// ------------------------------------------------------------------------------------------------------------

/// Tool, bodies and obstacles share one set of names.
class NameRegister {
 public:
  void take(const Value& value, const std::string& name) {
    if (!taken_.insert(name).second) value.fail(fmt::format("the name \"{}\" is given twice", name));
  }

 private:
  std::set<std::string> taken_{"tool"};
};

std::vector<Field> runFields(SceneConfig& config) {
  const auto stepField = [](double& target, const Range& range) {
    return [&target, range](const Value& value) { value.fields({required(numberField("step", target, range))}); };
  };
  return {numberField("duration", config.duration, limits::duration),
          {"visual", stepField(config.visual_step, limits::visual_step)},
          {"haptic", stepField(config.haptic_step, limits::haptic_step)},
          integerField("latency", config.latency, 0, limits::latency),
          choiceField("method", config.method, methodNames()),
          choiceField("aim", config.aim, aimNames()),
          booleanField("weight_compensation", config.weight_compensation),
          {"seed", [&config](const Value& value) { config.seed = value.seed(); }},
          {"linearization", [&config](const Value& value) {
             value.fields({choiceField("derivative", config.derivative, derivativeNames())});
           }}};
}

std::vector<Field> worldFields(SceneConfig& config, NameRegister& names) {
  const auto readBodies = [&](const Value& list) {
    for (const Value& item : list.items(max_bodies)) {
      config.bodies.push_back(readFreeBody(item, config.bodies.size()));
      names.take(item, config.bodies.back().name);
    }
  };
  const auto readObstacles = [&](const Value& list) {
    for (const Value& item : list.items(max_obstacles)) {
      config.obstacles.push_back(readObstacle(item, config.obstacles.size()));
      names.take(item, config.obstacles.back().name);
    }
  };
  return {vectorField("gravity", config.gravity, Range::within(-1000.0, 1000.0, "m/s^2")),
          {"contact", [&config](const Value& value) { readContact(value, config.contact); }},
          required({"tool", [&config](const Value& value) { readTool(value, config.tool); }}),
          {"bodies", readBodies},
          {"obstacles", readObstacles},
          {"link", [&config](const Value& value) { readLink(value, config.link); }},
          {"device", [&config](const Value& value) { readDevice(value, config.device); }},
          {"safety", [&config](const Value& value) { readSafety(value, config.safety); }}};
}

void readVersion(const Value& value) {
  const int version = value.integer(0, 1000000);
  if (version != schema_version)
    value.fail(fmt::format("schema version {} is not known; this program reads version {}", version, schema_version));
}

void readRoot(const Value& root, SceneConfig& config) {
  NameRegister names;
  std::vector<Field> fields{required({"palpate", readVersion}),
                            required(nameField(config.name)),
                            {"description", [&](const Value& v) { config.description = v.text(10000); }}};
  for (Field& field : runFields(config)) fields.push_back(std::move(field));
  for (Field& field : worldFields(config, names)) fields.push_back(std::move(field));
  root.fields(fields);
}

}  // namespace

SceneConfig readSceneFromString(std::string_view text, const std::string& name) {
  SceneConfig config;
  readRoot(Value(name, "", parseDocument(text, name)), config);
  if (const auto cause = timingObjection(config)) throw InputError(name, "visual.step", *cause);
  if (const auto cause = sizeObjection(config)) throw InputError(name, "", *cause);
  return config;
}

SceneConfig readScene(const std::filesystem::path& file) {
  SceneConfig config = readSceneFromString(readDocumentText(file), file.string());
  config.file = file;
  resolveFiles(config);
  return config;
}

}  // namespace palpate
