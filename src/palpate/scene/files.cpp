#include <fmt/format.h>

#include "palpate/common/error.h"
#include "palpate/scene/reader.h"
#include "palpate/scene/value.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

bool isFile(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

/// Folders in which a package may keep its data, e.g. glmark2-data its models in glmark2.
std::vector<fs::path> foldersOf(const std::string& package, const std::vector<fs::path>& data_folders) {
  std::vector<std::string> names{package};
  const std::string suffix = "-data";
  if (package.size() > suffix.size() && package.ends_with(suffix))
    names.push_back(package.substr(0, package.size() - suffix.size()));
  std::vector<fs::path> folders;
  for (const fs::path& data : data_folders)
    for (const std::string& name : names) folders.push_back(data / name);
  return folders;
}

class Resolver {
 public:
  Resolver(const fs::path& scene, const std::vector<fs::path>& data_folders)
      : scene_(scene), data_folders_(data_folders) {}

  void resolve(const std::string& key, FileReference& reference) const {
    if (!reference.path.empty()) return;
    reference.path = reference.package.empty() ? besideScene(key, reference) : inPackage(key, reference);
  }

  void resolveShape(const std::string& owner, ShapeConfig& shape) const {
    if (auto* surface = std::get_if<SurfaceShapeConfig>(&shape)) resolve(owner + ".shape.surface.file", surface->file);
    if (auto* mesh = std::get_if<TetrahedraFileShapeConfig>(&shape))
      resolve(owner + ".shape.tetrahedra_file", mesh->file);
  }

 private:
  fs::path besideScene(const std::string& key, const FileReference& reference) const {
    const fs::path path = scene_.parent_path() / reference.file;  // an absolute file replaces the folder
    if (!isFile(path))
      throw InputError(scene_.string(), key, fmt::format("no such file {}", shownText(path.string(), 400)));
    return path;
  }

  fs::path inPackage(const std::string& key, const FileReference& reference) const {
    for (const fs::path& folder : foldersOf(reference.package, data_folders_))
      if (const fs::path path = folder / reference.file; isFile(path)) return path;
    throw InputError(scene_.string(), key,
                     fmt::format("{} is not installed; it comes with the Debian package {} (apt-get install {})",
                                 shownText(reference.file, 400), reference.package, reference.package));
  }

  const fs::path& scene_;
  const std::vector<fs::path>& data_folders_;
};

}  // namespace

std::vector<fs::path> packageDataFolders() { return {"/usr/local/share", "/usr/share"}; }

void resolveFiles(SceneConfig& config, const std::vector<fs::path>& data_folders) {
  const Resolver resolver(config.file, data_folders);
  resolver.resolveShape("tool", config.tool.shape);
  for (std::size_t i = 0; i < config.bodies.size(); ++i)
    resolver.resolveShape(fmt::format("bodies[{}]", i), config.bodies[i].shape);
  for (std::size_t i = 0; i < config.obstacles.size(); ++i)
    if (auto* mesh = std::get_if<MeshObstacleConfig>(&config.obstacles[i].geometry))
      resolver.resolveShape(fmt::format("obstacles[{}].mesh", i), mesh->shape);
  if (config.device.recording) resolver.resolve("device.file", *config.device.recording);
}

}  // namespace palpate
