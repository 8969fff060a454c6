#include <algorithm>

#include "palpate/common/error.h"
#include "palpate/interactive/interactive_run.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {

namespace {

constexpr double kSize = 0.15;  // longest side [m]

Surface readDropped(const std::filesystem::path& file) {
  try {
    return loadSolid(file.string(), kSize);
  } catch (const InputError& e) {
    // the folder that the file was put in means nothing to whoever sent it
    std::string cause = e.what();
    const std::string folder = file.parent_path().string() + "/";
    for (auto at = cause.find(folder); at != std::string::npos; at = cause.find(folder)) cause.erase(at, folder.size());
    throw RunError(cause);
  }
}

}  // namespace

SceneConfig sceneOfSurface(const std::filesystem::path& file, const std::string& name) {
  constexpr double kHeld = 0.25;        // share of the height that is the handle
  constexpr double kWeight = 0.6;       // a small device holds 0.88 N for long [N]
  constexpr double kMostDensity = 300;  // foam [kg/m^3]
  constexpr double kGravity = 9.81;
  const Surface surface = readDropped(file);
  const double height = boundsOf(surface.vertices).high.z() - boundsOf(surface.vertices).low.z();
  const double volume = surfaceMassProperties(surface, 1.0, name).mass;

  SceneConfig config;
  config.file = file;
  config.name = std::filesystem::path(name).stem().string();
  config.description = "A surface of your own, soft, on the ground, held by its upper part.";
  config.tool.name = "tool";
  SurfaceShapeConfig shape;
  shape.file = {file.string(), "", file};
  shape.size = kSize;
  config.tool.shape = shape;
  config.tool.tetrahedra = 600;
  config.tool.material.youngs_modulus = 2e4;
  config.tool.material.density = std::clamp(kWeight / (kGravity * volume), 1.0, kMostDensity);
  HandleConfig handle;
  handle.name = "top";
  handle.region = HalfspaceRegionConfig{Vec3(0, 0, (1 - kHeld) * height), Vec3::UnitZ()};
  handle.mass = 0.02;
  config.tool.handles = {handle};
  config.tool.handle = handle.name;
  config.obstacles.push_back({"ground", PlaneObstacleConfig{}, 0.5});
  return config;
}

}  // namespace palpate
