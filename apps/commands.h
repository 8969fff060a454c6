#pragma once

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cstdio>
#include <stdexcept>
#include <string>

namespace palpate {

/// The job was done and written, but what it looked at is not as it must be. Exit code 3.
class ChecksFailed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A signal ended the job before its time, and what there is was written. Exit code 128 + signal.
class Interrupted : public std::runtime_error {
 public:
  Interrupted(const std::string& what, int signal) : std::runtime_error(what), signal_(signal) {}
  int signal() const { return signal_; }

 private:
  int signal_;
};

/// Why a flush of standard output failed first, as errno; 0: none has. The stream itself forgets it.
inline int output_error = 0;
inline void flushOutput() {
  if (std::fflush(stdout) != 0 && output_error == 0) output_error = errno;
}

// Each adds one subcommand to the program. Its callback does the job; it throws InputError (exit code 2) for bad input
// and RunError (exit code 1) for a failed run.

void addRunCommand(CLI::App& app);
void addOneDCommand(CLI::App& app);
void addCheckCommand(CLI::App& app);
void addEvaluateCommand(CLI::App& app);
void addStressCommand(CLI::App& app);
void addMeshCommand(CLI::App& app);
void addValidateCommand(CLI::App& app);
void addDevicesCommand(CLI::App& app);
void addManualCommand(CLI::App& app);
void addCompletionCommand(CLI::App& app);
void addViewCommand(CLI::App& app);
void addReplayCommand(CLI::App& app);
void addExportCommand(CLI::App& app);
void addLatencyCommand(CLI::App& app);
void addSoakCommand(CLI::App& app);
void addStudyCommand(CLI::App& app);
void addSchemaCommand(CLI::App& app);

}  // namespace palpate
