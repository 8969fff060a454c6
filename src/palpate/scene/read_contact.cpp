#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "palpate/scene/checks.h"
#include "palpate/scene/read_parts.h"
#include "palpate/scene/text.h"

// Obstacles, contact and friction.

namespace palpate::reading {
namespace {

constexpr std::size_t kMaxPairs = 10000;

PlaneObstacleConfig readPlane(const Value& value) {
  PlaneObstacleConfig plane;
  value.fields({vectorField("point", plane.point, kCoordinate), directionField("normal", plane.normal)});
  return plane;
}

BoxObstacleConfig readBoxObstacle(const Value& value) {
  BoxObstacleConfig box;
  Vec3 rotation = Vec3::Zero();
  value.fields({required(vectorField("center", box.pose.position, kCoordinate)),
                required(vectorField("half_extents", box.half_extents, kSize)),
                rotationField("rotation", rotation, 3600.0)});
  box.pose.rotation = expRotation(rotation);
  return box;
}

SphereObstacleConfig readSphereObstacle(const Value& value) {
  SphereObstacleConfig sphere;
  value.fields({required(vectorField("center", sphere.center, kCoordinate)),
                required(numberField("radius", sphere.radius, kSize))});
  return sphere;
}

CapsuleObstacleConfig readCapsuleObstacle(const Value& value) {
  CapsuleObstacleConfig capsule;
  value.fields({required(vectorField("a", capsule.a, kCoordinate)), required(vectorField("b", capsule.b, kCoordinate)),
                required(numberField("radius", capsule.radius, kSize))});
  return capsule;
}

MeshObstacleConfig readMeshObstacle(const Value& value) {
  MeshObstacleConfig mesh;
  value.fields({shapeField(mesh.shape), poseField("pose", mesh.pose)});
  requireSurface(value, mesh.shape, "an obstacle");
  return mesh;
}

/// What friction pairs may name.
class ContactPartners {
 public:
  explicit ContactPartners(const SceneConfig& scene) {
    add(scene.tool.name, Kind::soft);
    for (const FreeBodyConfig& body : scene.bodies) add(body.name, body.rigid ? Kind::rigid : Kind::soft);
    for (const ObstacleConfig& obstacle : scene.obstacles) add(obstacle.name, Kind::obstacle);
  }

  std::string read(const Value& value) const {
    std::string name = value.name();
    if (!kinds_.contains(name))
      value.fail(fmt::format("there is no tool, body or obstacle {}; the nearest is \"{}\"", shownText(name),
                             nearestWord(name, names_)));
    return name;
  }

  /// Why the two never touch, if so.
  std::optional<std::string> objection(const std::string& first, const std::string& second) const {
    const Kind a = kinds_.at(first), b = kinds_.at(second);
    if (a == Kind::obstacle && b == Kind::obstacle) return "obstacles do not touch each other";
    if (first == second && a == Kind::rigid) return "a rigid body does not touch itself";
    return std::nullopt;
  }

 private:
  enum class Kind { soft, rigid, obstacle };
  void add(const std::string& name, Kind kind) {
    kinds_[name] = kind;
    names_.push_back(name);
  }
  std::map<std::string, Kind> kinds_;
  std::vector<std::string> names_;
};

FrictionPairConfig readPair(const Value& value, const ContactPartners& partners) {
  FrictionPairConfig pair;
  const auto readNames = [&](const Value& list) {
    const std::vector<Value> names = list.exactly(2, "names");
    pair.first = partners.read(names[0]);
    pair.second = partners.read(names[1]);
    if (const auto cause = partners.objection(pair.first, pair.second)) list.fail(*cause);
  };
  value.fields({required({"between", readNames}), required(numberField("friction", pair.value, kFrictionCoefficient))});
  return pair;
}

std::vector<FrictionPairConfig> readPairs(const Value& value, const SceneConfig& scene) {
  const ContactPartners partners(scene);
  std::vector<FrictionPairConfig> pairs;
  std::set<std::pair<std::string, std::string>> named;
  for (const Value& item : value.items(kMaxPairs)) {
    pairs.push_back(readPair(item, partners));
    const FrictionPairConfig& pair = pairs.back();
    if (!named.insert(std::minmax(pair.first, pair.second)).second)
      item.fail(fmt::format("the pair {} and {} is given twice", pair.first, pair.second));
  }
  return pairs;
}

}  // namespace

ObstacleConfig readObstacle(const Value& value, std::size_t index) {
  ObstacleConfig obstacle;
  obstacle.name = fmt::format("obstacle-{}", index + 1);
  const auto field = [&obstacle](const char* key, auto read) {
    return Field{key, [&obstacle, read](const Value& v) { obstacle.geometry = read(v); }};
  };
  value.oneOf({field("plane", readPlane), field("box", readBoxObstacle), field("sphere", readSphereObstacle),
               field("capsule", readCapsuleObstacle), field("mesh", readMeshObstacle)},
              {nameField(obstacle.name), frictionField(obstacle.friction)});
  return obstacle;
}

void readContact(const Value& value, const SceneConfig& scene, ContactConfig& contact) {
  ContactSettings& settings = contact.settings;
  const auto readSolver = [&](const Value& solver) {
    solver.fields({integerField("max_iterations", settings.solver.max_iterations, 1, 1000000),
                   numberField("tolerance", settings.solver.tolerance, Range::between(0.0, 1.0, ""))});
  };
  value.fields({{"cone", [&](const Value& v) { settings.cone.exact = v.choice(coneNames()) == 1; }},
                integerField("facets", settings.cone.facets, 3, 64),
                numberField("friction", contact.friction, kFrictionCoefficient),
                {"pairs", [&](const Value& v) { contact.pairs = readPairs(v, scene); }},
                numberField("thickness", contact.thickness, Range::within(1e-6, 0.1, "m")),
                numberField("max_recovery_speed", settings.max_recovery_speed, Range::positive(100.0, "m/s")),
                numberField("margin", settings.margin, Range::positive(1.0, "m")),
                numberField("penetration_tolerance", settings.penetration_tolerance, Range::positive(0.01, "m")),
                integerField("max_passes", settings.max_passes, 1, 100),
                booleanField("reduction", settings.reduction),
                {"solver", readSolver}});
}

}  // namespace palpate::reading
