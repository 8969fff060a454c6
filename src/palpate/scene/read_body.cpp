#include <fmt/format.h>

#include "palpate/scene/checks.h"
#include "palpate/scene/limits.h"
#include "palpate/scene/read_parts.h"

// Tool and bodies: material, handles, state at the start.

namespace palpate::reading {
namespace {

constexpr std::size_t kMaxHandles = 50;
constexpr std::size_t kMaxKeyframes = 10000;
constexpr std::size_t kMaxParts = 100;

const Range kYoungsModulus = Range::positive(1e12, "Pa");
const Range kPoissonRatio = Range::between(-1.0, 0.5, "");
const Range kDensity = Range::positive(1e5, "kg/m^3");

MaterialPartConfig readMaterialPart(const Value& value, const BodyConfig& body) {
  MaterialPartConfig part;
  part.poisson_ratio = body.material.poisson_ratio;
  part.density = body.material.density;
  value.fields({regionField(part.region, body.shape),
                required(numberField("youngs_modulus", part.youngs_modulus, kYoungsModulus)),
                numberField("poisson_ratio", part.poisson_ratio, kPoissonRatio),
                numberField("density", part.density, kDensity)});
  return part;
}

/// The shape must have been read before, and parts come last: they take over what the body has.
void readMaterial(const Value& value, BodyConfig& body) {
  MaterialConfig& material = body.material;
  const auto readParts = [&](const Value& list) {
    for (const Value& item : list.items(kMaxParts)) material.parts.push_back(readMaterialPart(item, body));
  };
  value.fields({numberField("youngs_modulus", material.youngs_modulus, kYoungsModulus),
                numberField("poisson_ratio", material.poisson_ratio, kPoissonRatio),
                numberField("density", material.density, kDensity),
                numberField("damping_alpha", material.damping_alpha, Range::within(0.0, 1e4, "1/s")),
                numberField("damping_beta", material.damping_beta, Range::within(0.0, 10.0, "s")),
                {"parts", readParts}});
}

/// What deformable bodies have, beside a shape that has been read before.
std::vector<Field> softFields(BodyConfig& body) {
  const auto readTetrahedra = [&body](const Value& value) {
    if (!isSurface(body.shape)) value.fail("this shape has tetrahedra of its own; only embedded surfaces take a count");
    body.tetrahedra = value.integer(limits::kMinTetrahedra, limits::kTetrahedra);
  };
  return {{"tetrahedra", readTetrahedra},
          {"material", [&body](const Value& value) { readMaterial(value, body); }},
          booleanField("self_contact", body.self_contact)};
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
    for (const Value& item : list.items(kMaxKeyframes)) {
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

/// The field for bodies that are rigid or soft, as `rigid` says; for others the key is an error.
Field onlyFor(const FreeBodyConfig& body, bool rigid, const Field& field, const char* objection) {
  return {field.key, [&body, rigid, field, objection](const Value& value) {
            if (body.rigid != rigid) value.fail(objection);
            field.read(value);
          }};
}

Field freeShapeField(FreeBodyConfig& body) {
  const Field any = shapeField(body.shape);
  return required({any.key, [any, &body](const Value& value) {
                     any.read(value);
                     if (body.rigid) requireSurface(value, body.shape, "a rigid body");
                   }});
}

// start: rest or settled
Field startField(bool& settled) {
  static const std::vector<std::string> starts{"rest", "settled"};
  return {"start", [&settled](const Value& v) { settled = v.choice(starts) == 1; }};
}

}  // namespace

void readTool(const Value& value, ToolConfig& tool) {
  tool.name = "tool";
  const auto readHandles = [&](const Value& handles) {
    for (const auto& [name, handle] : handles.namedEntries(kMaxHandles))
      tool.handles.push_back(readHandle(handle, name, tool.shape));
    if (tool.handles.empty()) handles.fail("is empty; the tool needs at least one handle");
    tool.handle = tool.handles.front().name;
  };
  const auto chooseHandle = [&](const Value& handle) {
    tool.handle = handle.name();
    if (const auto cause = handleObjection(tool, tool.handle)) handle.fail(*cause);
  };
  std::vector<Field> fields{shapeField(tool.shape), poseField("pose", tool.pose), frictionField(tool.friction)};
  for (Field& field : softFields(tool)) fields.push_back(std::move(field));
  fields.push_back(required({"handles", readHandles}));
  fields.push_back({"handle", chooseHandle});
  fields.push_back(startField(tool.settled));
  value.fields(fields);
}

FreeBodyConfig readFreeBody(const Value& value, std::size_t index) {
  constexpr const char* soft_only = "is for soft bodies; a rigid body has a density and nothing else of a material";
  FreeBodyConfig body;
  body.name = fmt::format("body-{}", index + 1);
  std::vector<Field> fields{booleanField("rigid", body.rigid), freeShapeField(body)};  // the others depend on these
  for (const Field& field : softFields(body)) fields.push_back(onlyFor(body, false, field, soft_only));
  fields.push_back(
      onlyFor(body, false, startField(body.settled), "is for soft bodies; a rigid body starts as it is placed"));
  fields.push_back(onlyFor(body, true, numberField("density", body.material.density, kDensity),
                           "is for rigid bodies; the density of a soft one is in its material"));
  fields.push_back(poseField("pose", body.pose));
  fields.push_back(frictionField(body.friction));
  fields.push_back(nameField(body.name));
  fields.push_back(vectorField("velocity", body.velocity, Range::within(-100.0, 100.0, "m/s")));
  fields.push_back(rotationField("angular_velocity", body.angular_velocity, 36000.0));
  value.fields(fields);
  return body;
}

}  // namespace palpate::reading
