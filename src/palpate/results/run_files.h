#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "palpate/results/snapshots.h"
#include "palpate/scene/builder.h"
#include "palpate/scene/config.h"
#include "palpate/session/lockstep.h"
#include "palpate/session/run_record.h"

namespace palpate {

/// Forces of another method along the same motion, shown beside the run's own.
struct Comparison {
  std::string method;
  std::vector<double> time;  ///< [s]
  std::vector<Vec6> raw;     ///< wrench on the device [N; N m]
};

/// Writes the files of a run (docs/files.md): haptic.csv, motion.csv, visual.csv, timing.csv, summary.json,
/// report.html, and with pictures picture-1.png, ... and pictures.png.
class RunFiles {
 public:
  /// @throws InputError if the folder cannot be written
  RunFiles(const std::filesystem::path& folder, const SceneConfig& config);
  ~RunFiles();

  RunSink sink();
  /// Path for another file of the run, which must be complete before finish().
  std::filesystem::path stage(const std::string& name);
  /// Completes the files and gives them their names.
  void finish(const BuiltScene& scene, const RunOutcome& outcome, const Comparison* comparison,
              const RunPictures& pictures = {});
  /// A short table of the run for the terminal; after finish().
  std::string table() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
