#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

/// The folder that a job writes into. Files are written under temporary names and all get their own names in commit(),
/// so that a job that fails or is interrupted (common/interruption.h) leaves nothing that looks complete, and an
/// earlier job's files whole.
///
///     OutputFolder folder("out/alien");
///     CsvWriter csv(folder.stage("haptic.csv"), {"time_s", "force_N"});
///     ...
///     csv.close();
///     writeJson(folder.stage("summary.json"), summary);
///     folder.commit();
class OutputFolder {
 public:
  /// Makes the folder if it is missing and makes sure that files can be written there.
  /// @throws InputError if it cannot be made or written to
  explicit OutputFolder(std::filesystem::path path);
  /// Removes what was staged and not committed, and the folders made for it as far as they are empty.
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

  /// The temporary path to write the file `name` to.
  std::filesystem::path stage(const std::string& name);

  /// The file is not part of the result after all.
  void unstage(const std::string& name);

  /// Gives the staged files their names, in the order of staging (stage summary.json last). They must be closed.
  /// @throws RunError if a staged file was not written or cannot be renamed
  void commit();

 private:
  struct Staged {
    std::filesystem::path temporary, final;
  };

  void forgetProvisional();

  std::filesystem::path path_;
  std::vector<std::filesystem::path> made_;  // by this; outermost first
  std::vector<Staged> staged_;
};

}  // namespace palpate
