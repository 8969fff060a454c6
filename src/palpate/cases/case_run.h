#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

namespace palpate {

// What is in the folder of a case that is done: result/
//
//     done.json     digest of what it was made of (case.json, scene.yaml, the files that it names), and of the program
//     summary.json  of palpate run, evaluate or stress, without times
//     timing.json   seconds that it took, and the times of the summary
//     rows of ticks and steps, rides.csv, report.html as the study asks for
//
// It appears whole or not at all. All but timing.* is the same to the byte wherever it was made, on one kind of
// machine.

/// How a case stands.
struct CaseState {
  enum class Kind { missing, done, failed };
  Kind kind = Kind::missing;
  std::string cause;    ///< of a failure
  std::string program;  ///< digest of that which made it
};

/// One whose inputs cannot be read any more has failed.
CaseState caseState(const std::filesystem::path& folder, int number);

enum class CaseOutcome {
  done,          ///< now
  done_before,   ///< nothing was to do
  checks_failed  ///< done now; what it looked at is not as it must be
};

/// Runs a case of a planned study, unless it is done with the same inputs. May run at several places at a time: the
/// first to end leaves its result. What it was at when it was lost is removed by whoever runs it next.
/// @param again     even if it is done
/// @param progress  share done, 0 to 1
/// @throws InputError for a case that the plan does not have; RunError if it failed, which failed.json tells then
CaseOutcome runCase(
    const std::filesystem::path& folder, int number, bool again,
    const std::function<void(double)>& progress = [](double) {});

/// Takes the times out of a summary: what differs from run to run. @returns them, under the same keys
nlohmann::ordered_json takeTimes(nlohmann::ordered_json& summary);

}  // namespace palpate
