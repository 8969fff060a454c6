#pragma once

#include <string>
#include <vector>

#include "palpate/math/rotation.h"
#include "palpate/scene/config.h"
#include "palpate/scene/value.h"

// What the files that read a scene share; not for others.

namespace palpate::reading {

inline const Range kCoordinate = Range::within(-100.0, 100.0, "m");
inline const Range kSize = Range::within(1e-4, 10.0, "m");
inline const Range kFrictionCoefficient = Range::within(0.0, 10.0, "");

inline Field rotationField(const char* key, Vec3& target, double max_degrees) {
  return {key, [&target, max_degrees](const Value& value) { target = value.rotation(max_degrees); }};
}
inline Field frictionField(std::optional<double>& target) {
  return numberField("friction", target, kFrictionCoefficient);
}
inline Field nameField(std::string& target) {
  return {"name", [&target](const Value& value) { target = value.name(); }};
}
template <typename Enum>
Field choiceField(const char* key, Enum& target, const std::vector<std::string>& words) {
  return {key, [&target, &words](const Value& value) {
            const std::string before = words.at(static_cast<std::size_t>(target));
            target = static_cast<Enum>(value.choice(words));
            value.noteDefault(before);
          }};
}
inline Field poseField(const char* key, Pose& pose) {
  return {key, [&pose](const Value& value) {
            Vec3 rotation = Vec3::Zero();
            value.fields(
                {vectorField("position", pose.position, kCoordinate), rotationField("rotation", rotation, 3600.0)});
            pose.rotation = expRotation(rotation);
          }};
}

/// Text that is not empty.
std::string readFileName(const Value& value);

/// The required key `shape`.
Field shapeField(ShapeConfig& shape);
/// Rejects a shape that has tetrahedra of its own, which `owner`, e.g. "a rigid body", has no use for.
void requireSurface(const Value& value, const ShapeConfig& shape, const char* owner);
/// The required key `region` of a body with that shape, which must have been read before.
Field regionField(RegionConfig& region, const ShapeConfig& shape);

void readTool(const Value& value, ToolConfig& tool);
FreeBodyConfig readFreeBody(const Value& value, std::size_t index);
ObstacleConfig readObstacle(const Value& value, std::size_t index);
/// After tool, bodies and obstacles, which friction pairs name.
void readContact(const Value& value, const SceneConfig& scene, ContactConfig& contact);

}  // namespace palpate::reading
