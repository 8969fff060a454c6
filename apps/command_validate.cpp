#include <fmt/format.h>

#include <memory>

#include "commands.h"
#include "palpate/scene/builder.h"
#include "scene_options.h"

namespace palpate {
namespace {

void printScene(const SceneConfig& config, const BuiltScene& built) {
  fmt::print("{}: {} tetrahedra, {} nodes, {} surface triangles; {} bodies, {} obstacles\n", config.name,
             built.tetrahedra, built.nodes, built.surface_triangles, 1 + config.bodies.size(), config.obstacles.size());
  fmt::print("{:g} s with {}, visual step {:g} s of {} haptic ticks, {} device\n", config.duration,
             toString(config.method), config.visual_step, config.ticksPerStep(), toString(config.device.kind));
}

void printHandle(const BuiltScene& built) {
  const Body tool = built.world.tool();
  fmt::print("handle {}: {} nodes, weight of handle and tool {:.3g} N\n", tool.model.handle().name,
             tool.model.handle().nodes.size(), tool.model.totalMass() * built.world.gravity.norm());
}

/// Everything that a run would reject before its first step, with each of the handles in turn.
void validate(const SceneOptions& options) {
  SceneConfig config = options.read();
  const std::string chosen = config.tool.handle;
  const BuiltScene first = buildScene(config);
  printScene(config, first);
  printHandle(first);
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
