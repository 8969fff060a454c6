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

/// As what the rows of ticks and visual steps are kept: HDF5 for long runs; motion and times are CSV then too.
enum class RunTables { csv, hdf5, none };
/// csv, hdf5, none.
const std::vector<std::string>& runTablesNames();

struct RunFilesSettings {
  RunTables tables = RunTables::csv;
  bool page = true;  ///< report.html
};

/// Writes the files of a run (docs/files.md): haptic.csv, motion.csv, visual.csv, timing.csv, summary.json,
/// report.html, and with pictures picture-1.png, ... and pictures.png. Where a file cannot be written any more (full
/// disk) nothing more is recorded, failure() says why, and finish() keeps what there is, to the last whole row; some
/// room for that is set aside from the beginning.
class RunFiles {
 public:
  /// @throws InputError if the folder cannot be written
  RunFiles(const std::filesystem::path& folder, const SceneConfig& config, const RunFilesSettings& settings = {});
  ~RunFiles();

  /// Does not throw.
  RunSink sink();
  /// Why nothing more is recorded, for people; empty: all is well.
  const std::string& failure() const;
  /// Path for another file of the run, which must be complete before finish().
  std::filesystem::path stage(const std::string& name);
  /// Completes the files and gives them their names. Where one of them does not fit, failure() says so, and the others
  /// are there. @throws RunError where they cannot be named
  void finish(const BuiltScene& scene, const RunOutcome& outcome, const Comparison* comparison,
              const RunPictures& pictures = {});
  /// A short table of the run for the terminal; after finish(). Rows that are bad begin with "!".
  /// @param color  they are red too
  std::string table(bool color = false) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
