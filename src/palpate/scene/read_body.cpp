#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <limits>

#include "palpate/scene/checks.h"
#include "palpate/scene/limits.h"
#include "palpate/scene/read_parts.h"

// Tool and bodies: material, handles, state at the start.

namespace palpate::reading {
namespace {

constexpr std::size_t kMaxHandles = 50;
constexpr std::size_t kMaxKeyframes = 10000;
constexpr std::size_t kMaxParts = 100;
constexpr std::size_t kMaxAttachments = 100;

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

KeyframeConfig readKeyframe(const Value& value) {
  KeyframeConfig keyframe;
  value.fields({required(numberField("t", keyframe.time, Range::within(0.0, 3600.0, "s"))),
                vectorField("position", keyframe.position, Range::within(-10.0, 10.0, "m")),
                rotationField("rotation", keyframe.rotation, 360.0)});
  return keyframe;
}

void readHand(const Value& value, HandConfig& hand, const std::vector<Field>& others) {
  const auto readKeyframes = [&](const Value& list) {
    for (const Value& item : list.items(kMaxKeyframes)) {
      hand.keyframes.push_back(readKeyframe(item));
      const std::size_t count = hand.keyframes.size();
      if (count > 1 && hand.keyframes[count - 1].time <= hand.keyframes[count - 2].time)
        item.fail(fmt::format("t = {:g} s is not later than the keyframe before, {:g} s",
                              hand.keyframes[count - 1].time, hand.keyframes[count - 2].time));
    }
  };
  std::vector<Field> fields{{"keyframes", readKeyframes}, booleanField("smooth", hand.smooth)};
  fields.insert(fields.end(), others.begin(), others.end());
  value.fields(fields);
}

Wander readWander(const Value& value) {
  const Range when = Range::within(0.0, 3600.0, "s");
  Wander wander;
  int seed = 1;
  value.fields({required(numberField("band", wander.band, Range::within(0.1, 50.0, "Hz"))),
                vectorField("position", wander.position, Range::within(0.0, 1.0, "m")),
                rotationField("rotation", wander.rotation, 90.0), required(numberField("from", wander.from, when)),
                required(numberField("to", wander.to, when)),
                integerField("seed", seed, 0, std::numeric_limits<int>::max())});
  wander.seed = static_cast<std::uint32_t>(seed);
  if (wander.to <= wander.from)
    value.fail(fmt::format("ends at {:g} s, which is not later than {:g} s", wander.to, wander.from));
  return wander;
}

/// Of an attachment: keyframes, which may come again.
void readMotion(const Value& value, AttachmentConfig& attachment) {
  readHand(value, attachment.motion, {numberField("period", attachment.period, Range::positive(3600.0, "s"))});
  const std::vector<KeyframeConfig>& keys = attachment.motion.keyframes;
  if (keys.empty()) value.fail("has no keyframes");
  if (!keys.front().position.isZero(0.0) || !keys.front().rotation.isZero(0.0))
    value.fail("does not begin where the body is built: the first keyframe has a position or a rotation");
  if (attachment.period == 0) return;
  if (keys.back().time > attachment.period) value.fail("has keyframes after its period");
  if (keys.back().position != keys.front().position || keys.back().rotation != keys.front().rotation)
    value.fail("jumps where it comes again: the last keyframe is not the first's place");
}

AttachmentConfig readAttachment(const Value& value, const std::string& name, const ShapeConfig& shape) {
  AttachmentConfig attachment;
  attachment.name = name;
  value.fields({regionField(attachment.region, shape),
                numberField("stiffness", attachment.stiffness, Range::positive(1e12, "N/m^3")),
                numberField("damping", attachment.damping, Range::within(0.0, 1e9, "N s/m^3")),
                {"to", [&](const Value& v) { attachment.to = v.name(); }},
                {"motion", [&](const Value& v) { readMotion(v, attachment); }}});
  if (!attachment.to.empty() &&
      (attachment.stiffness || attachment.damping > 0 || !attachment.motion.keyframes.empty()))
    value.fail("is glued (to), and cannot have stiffness, damping or motion as well");
  if (attachment.damping > 0 && !attachment.stiffness) value.fail("has damping but no stiffness; without, it is fixed");
  return attachment;
}

/// What deformable bodies have, beside a shape that has been read before.
std::vector<Field> softFields(BodyConfig& body) {
  const auto readTetrahedra = [&body](const Value& value) {
    if (!isSurface(body.shape)) value.fail("this shape has tetrahedra of its own; only embedded surfaces take a count");
    body.tetrahedra = value.integer(limits::kMinTetrahedra, limits::kTetrahedra);
  };
  const auto readAttachments = [&body](const Value& value) {
    for (const auto& [name, item] : value.namedEntries(kMaxAttachments))
      body.attachments.push_back(readAttachment(item, name, body.shape));
  };
  return {{"tetrahedra", readTetrahedra},
          {"attachments", readAttachments},
          {"material", [&body](const Value& value) { readMaterial(value, body); }},
          booleanField("self_contact", body.self_contact)};
}

/// Principal moments of a body that can exist: no one exceeds the sum of the other two.
Vec3 readInertia(const Value& value) {
  const Vec3 inertia = value.vector(Range::positive(100.0, "kg m^2"));
  if (2.0 * inertia.maxCoeff() > inertia.sum() * (1.0 + 1e-9))
    value.fail("one moment exceeds the sum of the other two");
  return inertia;
}

HandleConfig readHandle(const Value& value, const std::string& name, const ToolConfig& tool) {
  HandleConfig handle;
  handle.name = name;
  std::vector<Field> fields{numberField("mass", handle.mass, Range::positive(100.0, "kg")),
                            {"inertia", [&](const Value& v) { handle.inertia = readInertia(v); }},
                            {"hand", [&](const Value& v) {
                               HandConfig& hand = handle.hand;
                               readHand(v, hand, {{"wander", [&](const Value& w) { hand.wander = readWander(w); }}});
                             }}};
  if (tool.rigid) {
    fields.push_back({"region", [](const Value& v) { v.fail("a rigid tool is held as a whole"); }});
  } else {
    fields.push_back(regionField(handle.region, tool.shape));
    if (value.describes()) fields.back().required = false;  // of a rigid tool it has none
  }
  value.fields(fields);
  return handle;
}

/// The field for bodies that are rigid or soft, as `rigid` says; for others the key is an error.
Field onlyFor(const bool& is_rigid, bool rigid, const Field& field, const char* objection) {
  return {field.key, [&is_rigid, rigid, field, objection](const Value& value) {
            if (is_rigid != rigid && !value.describes()) value.fail(objection);
            field.read(value);
          }};
}

template <class Body>
Field shapeFieldOf(Body& body, const char* rigid_name) {
  const Field any = shapeField(body.shape);
  return required({any.key, [any, &body, rigid_name](const Value& value) {
                     any.read(value);
                     if (body.rigid) requireSurface(value, body.shape, rigid_name);
                   }});
}

constexpr const char* kSoftOnly = "is for soft bodies; a rigid body has a density and nothing else of a material";
constexpr const char* kRigidOnly = "is for rigid bodies; the density of a soft one is in its material";

/// What deformable bodies and rigid ones have, each what is its own.
template <class Body>
void addKindFields(Body& body, const char* rigid_name, std::vector<Field>& fields) {
  fields.push_back(booleanField("rigid", body.rigid));  // the others depend on these two
  fields.push_back(shapeFieldOf(body, rigid_name));
  for (const Field& field : softFields(body)) fields.push_back(onlyFor(body.rigid, false, field, kSoftOnly));
  fields.push_back(onlyFor(body.rigid, true, numberField("density", body.material.density, kDensity), kRigidOnly));
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
      tool.handles.push_back(readHandle(handle, name, tool));
    if (tool.handles.empty()) handles.fail("is empty; the tool needs at least one handle");
    tool.handle = tool.handles.front().name;
  };
  const auto chooseHandle = [&](const Value& handle) {
    tool.handle = handle.name();
    if (const auto cause = handleObjection(tool, tool.handle)) handle.fail(*cause);
  };
  std::vector<Field> fields;
  addKindFields(tool, "a rigid tool", fields);
  fields.push_back(poseField("pose", tool.pose));
  fields.push_back(frictionField(tool.friction));
  fields.push_back(required({"handles", readHandles}));
  fields.push_back({"handle", chooseHandle});
  fields.push_back(startField(tool.settled));
  value.fields(fields);
}

FreeBodyConfig readFreeBody(const Value& value, std::size_t index) {
  FreeBodyConfig body;
  body.name = fmt::format("body-{}", index + 1);
  std::vector<Field> fields;
  addKindFields(body, "a rigid body", fields);
  fields.push_back(
      onlyFor(body.rigid, false, startField(body.settled), "is for soft bodies; a rigid body starts as it is placed"));
  fields.push_back(poseField("pose", body.pose));
  fields.push_back(frictionField(body.friction));
  fields.push_back(nameField(body.name));
  fields.push_back(vectorField("velocity", body.velocity, Range::within(-100.0, 100.0, "m/s")));
  fields.push_back(rotationField("angular_velocity", body.angular_velocity, 36000.0));
  value.fields(fields);
  const bool held = std::any_of(body.attachments.begin(), body.attachments.end(),
                                [](const AttachmentConfig& a) { return a.to.empty(); });
  if (held && !(body.velocity.isZero(0.0) && body.angular_velocity.isZero(0.0)))
    value.fail("what the world holds starts without velocity");
  return body;
}

}  // namespace palpate::reading
