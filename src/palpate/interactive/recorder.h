#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <mutex>
#include <string>

#include "palpate/protocol/layout.h"
#include "palpate/protocol/messages.h"
#include "palpate/record/output_folder.h"

namespace palpate {

/// Writes recording.palpate (docs/viewer.md): what the page needs to show a run again, without the scene's files. Rows
/// and states may come from different threads. Where the file cannot be written any more (full disk) it ends with its
/// last whole record, and the rest is left out.
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

  /// Nothing more is recorded. Any thread, cheap.
  bool failed() const noexcept { return failed_.load(std::memory_order_relaxed); }
  /// Why nothing more is recorded, for people; empty: all is well. Any thread.
  std::string failure() const;
  /// Writes what is left, as far as that is possible.
  void finish();

 private:
  void put(protocol::RecordKind kind, const std::string& payload);
  void flushSamples();
  void giveUp(int cause);

  mutable std::mutex mutex_;
  std::filesystem::path path_;
  std::ofstream out_;
  std::uintmax_t whole_ = 0;  // bytes of whole records in the file
  std::string failure_;
  std::atomic<bool> failed_{false};
  StateReader reader_;
  SampleEncoder samples_;
  SceneState state_;
  TickRecord last_tick_;
  int substeps_ = 1;
};

}  // namespace palpate
