#include <fmt/format.h>

#include "palpate/scene/builder.h"

namespace palpate {
namespace {

constexpr double kDeep = 0.01;  // of a body's size: what lies deeper inside something was hardly meant to
constexpr double kLarge = 3.0;  // [m]
constexpr int kTurning = 3;     // nodes that turn a body about any axis

Vec3 extentOf(const Body& body) {
  const Bounds box = boundsOf(body.model.mesh().surface.vertices);
  return box.high - box.low;
}

}  // namespace

void noteStart(const SceneConfig& config, BuiltScene& scene) {
  World& world = scene.world;
  std::vector<double> size;
  for (int i = 0; i < world.bodies(); ++i) {
    const Vec3 extent = extentOf(world.body(i));
    size.push_back(extent.norm());
    if (extent.maxCoeff() > kLarge) {
      scene.notes.push_back(fmt::format("{} is {:.3g} x {:.3g} x {:.3g} m large: a file without `size` is in meters",
                                        world.body(i).model.name(), extent.x(), extent.y(), extent.z()));
    }
  }
  for (const SurfaceOverlap& overlap : world.overlaps()) {
    const int body = std::max(overlap.body[0], overlap.body[1]), other = std::min(overlap.body[0], overlap.body[1]);
    const int obstacle = std::max(overlap.obstacle[0], overlap.obstacle[1]);
    if (body < 0 || !(overlap.depth > kDeep * (other < 0 ? size[body] : std::min(size[body], size[other])))) continue;
    scene.notes.push_back(fmt::format(
        "{} starts {:.3g} mm inside {}: contact will push it out", world.body(body).model.name(), 1e3 * overlap.depth,
        other >= 0 ? world.body(other).model.name() : config.obstacles[static_cast<std::size_t>(obstacle)].name));
  }
  // a tool that settles is pushed out of what it starts in, against its link, which also bears its weight
  const BodyModel& tool = world.tool().model;
  const double away = (world.tool().state.handle.pose.position - scene.start.position).norm();
  const double sag = tool.totalMass() * world.gravity.norm() / world.link.stiffness;
  if (away > 2 * sag + kDeep * size[world.toolIndex()]) {
    scene.notes.push_back(
        fmt::format("{} starts {:.3g} mm away from the hand that holds it: something is in its way there", tool.name(),
                    1e3 * away));
  }
  const auto nodes = tool.handle().nodes.size();
  if (!tool.isRigid() && nodes < kTurning) {
    scene.notes.push_back(
        fmt::format("handle {} holds {} of the tool's nodes: the tool hinges there; a larger region turns it",
                    tool.handle().name, nodes));
  }
}

}  // namespace palpate
