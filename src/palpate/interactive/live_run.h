#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/protocol/messages.h"
#include "palpate/scene/config.h"
#include "palpate/viewer/audience.h"

namespace palpate {

struct LiveOptions {
  std::vector<SceneEntry> scenes;                        ///< to choose from
  std::function<SceneConfig(const SceneEntry&)> open;    ///< reads one; throws InputError
  std::filesystem::path record_folder = "out/recorded";  ///< recordings go below it
  std::filesystem::path surface_folder;                  ///< where dropped surfaces are kept while the program runs
  bool record_from_start = false;
};

/// A scene that runs in real time before an audience and does what it asks (docs/viewer.md). One thread of its own, the
/// pump, besides the two loops; the public calls come from any thread and return at once.
class LiveRun {
 public:
  LiveRun(SceneConfig config, LiveOptions options, Audience& audience);
  ~LiveRun();
  LiveRun(const LiveRun&) = delete;
  LiveRun& operator=(const LiveRun&) = delete;

  /// Builds the scene and starts it. @throws what building it throws
  void start();
  /// Ends the loops and completes a recording.
  void stop();

  void joined(int viewer);
  void left(int viewer);
  /// One message of a viewer; bad ones are answered with a notice.
  void message(int viewer, std::string_view json);
  /// A surface file becomes the tool of a new scene. @returns why not, if so
  std::optional<std::string> surface(const std::string& name, std::string&& content);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A scene in which a surface stands on the ground, held by its upper part: light, soft, 15 cm high at most.
/// @throws InputError if the file holds no usable surface
SceneConfig sceneOfSurface(const std::filesystem::path& file, const std::string& name);

}  // namespace palpate
