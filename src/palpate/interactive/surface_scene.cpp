#include "palpate/interactive/surface_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <numbers>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/scene/reader.h"

namespace palpate {

namespace {

Surface readDropped(const std::filesystem::path& file, double size) {
  try {
    return loadSolid(file.string(), size);
  } catch (const InputError& e) {
    throw RunError(withoutFolder(e.what(), file));
  }
}

std::string text(const Vec3& v) {
  const auto exact = [](double x) { return x == 0 ? 0.0 : x; };  // no -0
  return fmt::format("[{:.9g}, {:.9g}, {:.9g}]", exact(v.x()), exact(v.y()), exact(v.z()));
}

/// In quotation marks, as YAML takes them from JSON.
std::string quoted(const std::string& s) {
  return nlohmann::json(s).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// What can be the name of a scene.
std::string sceneName(const std::string& file) {
  std::string out = std::filesystem::path(file).stem().string().substr(0, 64);
  for (char& c : out) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '-' && c != '_' && c != '.') c = '-';
  }
  return out.find_first_not_of('.') == std::string::npos ? "surface" : out;
}

/// Where the points lie along a direction.
std::pair<double, double> reach(const std::vector<Vec3>& points, const Vec3& direction) {
  double low = points.front().dot(direction), high = low;
  for (const Vec3& p : points) {
    low = std::min(low, p.dot(direction));
    high = std::max(high, p.dot(direction));
  }
  return {low, high};
}

std::string regionText(const PlaceMessage& placement, const std::vector<Vec3>& points) {
  constexpr double kHeld = 0.25;  // share of the height that is the handle
  switch (placement.handle) {
    case PlaceMessage::Handle::box:
      return fmt::format("{{box: {{min: {}, max: {}}}}}", text(placement.min), text(placement.max));
    case PlaceMessage::Handle::painted: {
      std::string centers;
      for (const Vec3& c : placement.centers) centers += (centers.empty() ? "" : ", ") + text(c);
      return fmt::format("{{spheres: {{centers: [{}], radius: {:.9g}}}}}", centers, placement.radius);
    }
    case PlaceMessage::Handle::top:
      break;
  }
  const Vec3 up = placement.rotation.conjugate() * Vec3::UnitZ();
  const auto [low, high] = reach(points, up);
  return fmt::format("{{halfspace: {{point: {}, normal: {}}}}}", text((high - kHeld * (high - low)) * up), text(up));
}

/// Of the rest frame, so that what is turned stands over the origin.
std::string poseText(const Quat& rotation, std::vector<Vec3> points) {
  for (Vec3& p : points) p = rotation * p;
  const Bounds box = boundsOf(points);
  const Vec3 position(-box.center().x(), -box.center().y(), -box.low.z());
  return fmt::format("{{position: {}, rotation: {}}}", text(position),
                     text(logRotation(rotation) * (180.0 / std::numbers::pi)));
}

// The rest coordinates of a surface that `size` scales (docs/scene.md).
void stand(std::vector<Vec3>& points) {
  const Bounds box = boundsOf(points);
  for (Vec3& p : points) p -= Vec3(box.center().x(), box.center().y(), box.low.z());
}

SceneConfig readText(const std::string& text, const std::filesystem::path& file, const std::string& name) {
  SceneConfig config = readSceneFromString(text, name);
  config.file = file;
  resolveFiles(config);
  return config;
}

constexpr const char* kGround =
    "obstacles:\n  - {name: ground, plane: {point: [0, 0, 0], normal: [0, 0, 1]}, friction: 0.5}\n";

}  // namespace

std::string withoutFolder(std::string text, const std::filesystem::path& file) {
  const std::string folder = file.parent_path().string() + "/";
  for (auto at = text.find(folder); at != std::string::npos; at = text.find(folder)) text.erase(at, folder.size());
  return text;
}

SceneConfig sceneOfSurface(const std::filesystem::path& file, const std::string& name, const PlaceMessage& placement) {
  constexpr double kWeight = 0.6;       // a small device holds 0.88 N for long [N]
  constexpr double kMostDensity = 300;  // foam [kg/m^3]
  constexpr double kGravity = 9.81;
  Surface surface = readDropped(file, placement.size);
  stand(surface.vertices);
  const double volume = surfaceMassProperties(surface, 1.0, name).mass;
  const double density = std::clamp(kWeight / (kGravity * volume), 1.0, kMostDensity);
  std::string out = fmt::format("palpate: 1\nname: {}\n", sceneName(name));
  out += "description: A surface of your own, soft, on the ground.\ntool:\n";
  out += fmt::format("  shape: {{surface: {{file: {}, size: {:.9g}}}}}\n", quoted(name), placement.size);
  out += fmt::format("  pose: {}\n", poseText(placement.rotation, surface.vertices));
  out += fmt::format("  tetrahedra: {}\n", placement.tetrahedra);
  out += fmt::format("  material: {{youngs_modulus: 2.0e4, density: {:.4g}}}\n", density);
  const bool top = placement.handle == PlaceMessage::Handle::top;
  out += fmt::format("  handles:\n    {}:\n      region: {}\n      mass: 0.02\n", top ? "top" : "own",
                     regionText(placement, surface.vertices));
  return readText(out + kGround, file, name);
}

SceneConfig previewOfSurface(const std::filesystem::path& file, const std::string& name, SurfacePreview& preview) {
  const Bounds box = boundsOf(readDropped(file, 0).vertices);
  preview = {name, box.high - box.low, PlaceMessage{}.size};
  std::string out = fmt::format("palpate: 1\nname: {}\n", sceneName(name));
  out += "description: Turn it, choose its size and what the hand holds, then start.\ngravity: [0, 0, 0]\ntool:\n";
  out += fmt::format("  rigid: true\n  shape: {{surface: {{file: {}, size: {:.9g}}}}}\n", quoted(name), preview.size);
  return readText(out + "  handles: {all: {}}\n" + kGround, file, name);
}

}  // namespace palpate
