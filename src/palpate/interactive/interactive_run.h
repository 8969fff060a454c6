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

// Who runs what, and what crosses from one thread to another. The haptic loop waits for nobody. The others meet at
// three mutexes: tasks and inbox, held for a few assignments, and the recorder's, held by pump or visual loop for a
// write.
//
//   browsers
//      |  HTTP, WebSocket
//   +--v-----------------------------+
//   | server's thread: Server::run() |  the program's main thread; one event loop, knows no simulation
//   +--+--------------------------^--+
//      | joined, left, message,   | Audience: greet, state, text, frame, samples
//      | surface: tasks           | inbox: mutex, never waits for the network; bytes shared, not copied
//      | (mutex, wake-up)         |
//   +--v--------------------------+--+
//   | pump, every 1/60 s:            |  owned by InteractiveRun, from start() to stop(). Obeys commands, makes
//   messages, | InteractiveRun::Impl::run()    |  records; builds worlds; starts, stops and changes the loops. While
//   the loops
//   +--+-------------------------^---+  stand still it alone touches world and device
//      | HandCommand: newest     | TickRecord, VisualRecord: queues, in order; a full one drops and counts
//      | value, wait-free        | SceneState (nodes, contacts, stress): newest value
//      | stress on or off:       |
//      | atomic                  |
//   +--v-------------------------+---+
//   | RealtimeLoops: haptic loop and |  session/realtime_loops.h draws what passes between these two
//   | visual loop, a thread each     |
//   +--------------------------------+
//
// The workers of a ThreadTeam (threads/) serve whoever steps the world: the visual loop while it runs, else the pump.

namespace palpate {

struct InteractiveOptions {
  std::vector<SceneEntry> scenes;                        ///< to choose from
  std::function<SceneConfig(const SceneEntry&)> open;    ///< reads one; throws InputError
  std::filesystem::path record_folder = "out/recorded";  ///< recordings go below it
  std::filesystem::path surface_folder;                  ///< where dropped surfaces are kept while the program runs
  bool record_from_start = false;
};

/// A scene that runs in real time before an audience and does what it asks (docs/viewer.md). The public calls come from
/// any thread; all but start() and stop() return at once.
class InteractiveRun {
 public:
  InteractiveRun(SceneConfig config, InteractiveOptions options, Audience& audience);
  ~InteractiveRun();
  InteractiveRun(const InteractiveRun&) = delete;
  InteractiveRun& operator=(const InteractiveRun&) = delete;

  /// Builds the scene and starts it. @throws what building it throws
  void start();
  /// Begins what stop() does, from any thread, and returns at once.
  void askToStop();
  /// Ends the loops, a scene that is being built too, and completes a recording.
  void stop();
  /// After stop(): why a recording ended before it was told to, for people; empty: none did.
  const std::string& failure() const;

  void joined(int viewer);
  void left(int viewer);
  /// One message of a viewer; bad ones are answered with a notice.
  void message(int viewer, std::string_view json);
  /// A surface file becomes the tool of a new scene. @returns why not, if so
  /// @param place  shows it first, and waits until a viewer says how it is to stand and be held (PlaceMessage)
  std::optional<std::string> surface(const std::string& name, std::string&& content, bool place = false);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
