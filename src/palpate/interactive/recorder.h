#pragma once

#include <filesystem>
#include <fstream>
#include <memory>
#include <mutex>

#include "palpate/protocol/layout.h"
#include "palpate/protocol/messages.h"
#include "palpate/record/output_folder.h"

namespace palpate {

/// Writes recording.palpate (docs/viewer.md): what the page needs to show a run again, without the scene's files. Rows
/// and states may come from different threads.
class Recorder {
 public:
  /// @param file  to write; renamed by nobody but the caller
  /// @throws InputError if it cannot be written
  Recorder(const std::filesystem::path& file, const SceneConfig& config, const BuiltScene& scene,
           const InteractiveSettings& settings = {});

  /// A sink that records what it needs and passes all on to `sink`. This must outlive it.
  RunSink watch(RunSink sink);

  void tick(const TickRecord& tick);
  void step(const VisualRecord& step, int substeps);
  void state(const World& world, const VisualRecord& step);

  /// Writes what is left. @throws RunError if the file could not be written whole
  void finish();

 private:
  void put(protocol::RecordKind kind, const std::string& payload);
  void flushSamples();

  std::mutex mutex_;
  std::filesystem::path path_;
  std::ofstream out_;
  StateReader reader_;
  SampleEncoder samples_;
  SceneState state_;
  TickRecord last_tick_;
  int substeps_ = 1;
};

}  // namespace palpate
