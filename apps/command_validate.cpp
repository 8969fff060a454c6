#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "commands.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/scene/builder.h"
#include "scene_options.h"

namespace palpate {
namespace {

void printScene(const SceneConfig& config, const BuiltScene& built, const char* device) {
  fmt::print("{}: {} tetrahedra, {} nodes, {} surface triangles; {} bodies, {} obstacles\n", config.name,
             built.tetrahedra, built.nodes, built.surface_triangles, 1 + config.bodies.size(), config.obstacles.size());
  fmt::print("{:g} s with {}, visual step {:g} s of {} haptic ticks, {} device\n", config.duration,
             toString(config.method), config.visual_step, config.ticksPerStep(), device);
}

std::string place(const Vec3& p) {
  const auto round = [](double x) { return std::abs(x) < 1e-9 ? 0.0 : x; };
  return fmt::format("({:.3g}, {:.3g}, {:.3g})", round(p.x()), round(p.y()), round(p.z()));
}

/// As built, before anything settles.
void printBody(const World& world, int index) {
  const Body body = world.body(index);
  const auto partner = [&](const Attachment& a) {
    for (const Joint& joint : world.joints()) {
      if (joint.body == index && &body.model.attachments()[static_cast<std::size_t>(joint.attachment)] == &a)
        return world.body(joint.partner).model.name();
    }
    return std::string();
  };
  const Bounds box = boundsOf(body.model.mesh().surface.vertices);
  fmt::print("{}: {}, {:.3g} kg{}, from {} to {} m\n", body.model.name(),
             body.model.isRigid() ? "rigid" : fmt::format("{} free nodes", body.model.freeNodes()),
             body.model.totalMass(), body.model.held() ? " with its handle" : "", place(box.low), place(box.high));
  for (const Attachment& a : body.model.attachments()) {
    fmt::print("  {}: {} nodes around {} m, {}{}\n", a.name, a.nodes.size(), place(a.middle),
               a.fixed() ? "fixed"
               : a.glued ? "glued to " + partner(a)
                         : fmt::format("springs of {:.3g} N/m together", a.stiffness.sum()),
               a.motion ? ", driven" : "");
  }
}

void printHandle(const BuiltScene& built) {
  const BodyModel& tool = built.world.tool().model;
  fmt::print("handle {}: {} at {} m, weight of handle and tool {:.3g} N\n", tool.handle().name,
             tool.isRigid() ? "all of the tool," : fmt::format("{} nodes", tool.handle().nodes.size()),
             place(tool.handle().start.pose.position), tool.totalMass() * built.world.gravity.norm());
}

/// Everything that a run would reject before its first step, with each of the handles in turn.
void validate(const SceneOptions& options) {
  SceneConfig config = options.read();
  const std::string chosen = config.tool.handle;
  const DeviceName device = config.device.kind;
  if (isHardware(device)) config.device.kind = DeviceName::simulated;  // it is not asked for here
  BuiltScene first = buildScene(config);
  printScene(config, first, toString(device));
  for (int i = 0; i < first.world.bodies(); ++i) printBody(first.world, i);
  printHandle(first);
  noteStart(config, first);
  for (const std::string& note : first.notes) fmt::print("note: {}\n", note);
  if (options.overrides.handle) return;
  for (const HandleConfig& handle : config.tool.handles) {
    if (handle.name == chosen) continue;
    config.tool.handle = handle.name;
    printHandle(buildScene(config));
  }
}

}  // namespace

void addValidateCommand(CLI::App& app) {
  const auto options = std::make_shared<SceneOptions>();
  CLI::App* command = app.add_subcommand("validate", "Check a scene, its files and its meshes without running it");
  options->addScene(*command);
  options->addOverrides(*command);
  command->callback([options] { validate(*options); });
}

}  // namespace palpate
