#include "palpate/record/output_folder.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/common/interruption.h"

namespace palpate {

namespace fs = std::filesystem;

namespace {

std::string temporaryName(const std::string& name) {
  return "." + name + ".partial-" + std::to_string(static_cast<long>(::getpid()));
}

void requireWritable(const fs::path& folder) {
  const fs::path probe = folder / temporaryName("probe");
  markProvisional(probe);
  errno = 0;
  const bool opened = std::ofstream(probe, std::ios::binary).is_open();
  const int cause = errno;
  std::error_code ignored;
  fs::remove(probe, ignored);
  unmarkProvisional(probe);
  if (!opened)
    throw InputError(folder.string(), "", std::string("cannot write into this folder: ") + std::strerror(cause));
}

// The folders on the way to this one, itself included, that are not there; outermost first.
std::vector<fs::path> missingFolders(const fs::path& path) {
  std::vector<fs::path> out;
  std::error_code ignored;
  for (fs::path p = path; !p.empty() && !fs::exists(p, ignored); p = p.parent_path()) out.insert(out.begin(), p);
  return out;
}

}  // namespace

OutputFolder::OutputFolder(fs::path path) : path_(std::move(path)) {
  if (path_.empty()) throw InputError("--out", "", "the name of the output folder is empty");
  made_ = missingFolders(path_);
  for (const fs::path& folder : made_) markProvisional(folder);
  std::error_code status;
  fs::create_directories(path_, status);
  if (status) throw InputError(path_.string(), "", "cannot make this folder: " + status.message());
  if (!fs::is_directory(path_, status)) throw InputError(path_.string(), "", "is not a folder");
  requireWritable(path_);
}

OutputFolder::~OutputFolder() {
  const UninterruptedScope scope;
  std::error_code ignored;
  for (const Staged& file : staged_) fs::remove(file.temporary, ignored);
  for (auto folder = made_.rbegin(); folder != made_.rend(); ++folder) fs::remove(*folder, ignored);  // if empty
  forgetProvisional();
}

void OutputFolder::forgetProvisional() {
  for (const Staged& file : staged_) unmarkProvisional(file.temporary);
  for (const fs::path& folder : made_) unmarkProvisional(folder);
  staged_.clear();
  made_.clear();
}

fs::path OutputFolder::stage(const std::string& name) {
  staged_.push_back({path_ / temporaryName(name), path_ / name});
  markProvisional(staged_.back().temporary);
  return staged_.back().temporary;
}

void OutputFolder::unstage(const std::string& name) {
  const auto file =
      std::find_if(staged_.begin(), staged_.end(), [&](const Staged& s) { return s.final == path_ / name; });
  if (file == staged_.end()) return;
  std::error_code ignored;
  fs::remove(file->temporary, ignored);
  unmarkProvisional(file->temporary);
  staged_.erase(file);
}

void OutputFolder::commit() {
  const UninterruptedScope scope;
  std::error_code status;
  for (const Staged& file : staged_) {
    if (!fs::exists(file.temporary, status)) throw RunError(file.final.string() + ": was not written");
  }
  for (const Staged& file : staged_) {
    fs::rename(file.temporary, file.final, status);
    if (status) throw RunError(file.final.string() + ": cannot be put in place: " + status.message());
  }
  forgetProvisional();
}

}  // namespace palpate
