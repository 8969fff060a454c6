#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "commands.h"
#include "palpate/cases/case_report.h"
#include "palpate/cases/case_run.h"
#include "palpate/cases/plan.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/scene/reader.h"
#include "progress.h"

namespace palpate {
namespace {

struct StudyOptions {
  std::string study, out, folder;
  std::vector<int> cases;
  int jobs = 1;
  bool again = false;
};

void plan(const StudyOptions& options) {
  const StudyConfig study = readStudy(options.study);
  const std::string out = options.out.empty() ? "out/study-" + study.name : options.out;
  const int cases = writePlan(study, out);
  fmt::print("{}: {} {} in {}\n", study.name, cases, cases == 1 ? "case" : "cases", out);
  std::error_code ignored;
  if (std::filesystem::exists(caseFolder(out, cases + 1), ignored))
    fmt::print("note: cases of an earlier plan, from {} on, are left there\n", cases + 1);
  fmt::print("palpate study run {}, or there ./slurm.sh, ./parallel.sh, snakemake\n", out);
}

/// How a case that ran in this process ended; a failure is told, and the next one begins.
bool runHere(const StudyOptions& options, int number, bool only) {
  try {
    Progress progress(fmt::format("case {}", number));
    switch (runCase(options.folder, number, options.again, [&](double share) { progress(share); })) {
      case CaseOutcome::done_before:
        fmt::print("case {}: done already\n", number);
        break;
      case CaseOutcome::checks_failed:
        fmt::print("case {}: done; criteria are not met\n", number);
        break;
      case CaseOutcome::done:
        fmt::print("case {}: done\n", number);
        break;
    }
    std::fflush(stdout);
    return true;
  } catch (const std::runtime_error& e) {
    if (only) throw;
    fmt::print(stderr, "palpate: {}\n", e.what());
    return false;
  }
}

/// This program once more. However this process ends, that one is told to.
pid_t startAnother(const std::vector<char*>& arguments) {
  const pid_t parent = ::getpid();
  const pid_t process = ::fork();
  if (process < 0) throw RunError("cannot start another process of this program");
  if (process > 0) return process;
  // Only system calls: other threads, and what they have locked, are not there.
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() == parent) ::execv("/proc/self/exe", arguments.data());
  ::_exit(127);
}

/// Once a signal has asked, passes it on to the cases that run, which remove what is unfinished, and ends with them.
void endIfAsked(std::map<pid_t, int>& running) {
  if (!interruptionAsked()) return;
  while (!running.empty()) {
    // Again and again: one that comes while a process begins is lost.
    for (const auto& [process, number] : running) ::kill(process, interruptionSignal());
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    std::erase_if(running, [](const auto& one) { return ::waitpid(one.first, nullptr, WNOHANG) != 0; });
  }
  throw Interrupted("interrupted; the next run goes on with the cases that are not done", interruptionSignal());
}

/// Each case in a process of its own, with one thread, so many at a time. @returns those that failed
std::vector<int> runSideBySide(const StudyOptions& options, const std::vector<int>& cases) {
  std::vector<int> failed;
  std::map<pid_t, int> running;
  const InterruptionAsks asks;
  const auto await = [&] {
    int status = 0;
    pid_t ended = 0;
    // Looks now and then: a signal that comes right before the call would not end a wait.
    while ((ended = ::waitpid(-1, &status, WNOHANG)) == 0) {
      endIfAsked(running);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    const auto found = running.find(ended);
    if (found == running.end()) throw RunError("a case was lost track of");
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) failed.push_back(found->second);
    running.erase(found);
  };
  for (const int number : cases) {
    if (static_cast<int>(running.size()) == options.jobs) await();
    std::vector<std::string> words{"palpate", "--threads",    "1",      "study",
                                   "run",     options.folder, "--case", fmt::format("{}", number)};
    if (options.again) words.emplace_back("--again");
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    endIfAsked(running);
    running[startAnother(arguments)] = number;
  }
  while (!running.empty()) await();
  endIfAsked(running);
  return failed;
}

void run(const StudyOptions& options) {
  std::vector<int> cases = options.cases, failed;
  const int count = readPlan(options.folder).cases();
  if (cases.empty()) {
    cases.resize(static_cast<std::size_t>(count));
    std::iota(cases.begin(), cases.end(), 1);
  }
  for (const int number : cases)
    if (number < 1 || number > count)
      throw InputError("--case", "",
                       fmt::format("{} has no case {}; there are 1 to {}", options.folder, number, count));
  if (options.jobs > 1 && cases.size() > 1) {
    failed = runSideBySide(options, cases);
  } else {
    for (const int number : cases)
      if (!runHere(options, number, cases.size() == 1)) failed.push_back(number);
  }
  if (failed.empty()) return;
  std::sort(failed.begin(), failed.end());
  throw RunError(fmt::format("{} of {} cases failed: {}", failed.size(), cases.size(), numbersText(failed)));
}

void report(const StudyOptions& options) {
  const StudyState state = reportStudy(options.folder);
  fmt::print("{}: {} of {} cases are done\n", state.name, state.done, state.cases);
  if (!state.missing.empty()) fmt::print("missing: {}\n", numbersText(state.missing));
  for (const auto& [number, cause] : state.failed) fmt::print("case {} failed: {}\n", number, cause);
  if (!state.below.empty()) fmt::print("criteria not met: {}\n", numbersText(state.below));
  fmt::print("report: {}/report.html\n", options.folder);
  std::fflush(stdout);
  if (state.complete()) return;
  throw ChecksFailed(
      fmt::format("{}: {} cases are missing and {} failed", state.name, state.missing.size(), state.failed.size()));
}

void schema(const std::string& of) { fmt::print("{}\n", (of == "scene" ? sceneSchema() : studySchema()).dump(2)); }

}  // namespace

void addStudyCommand(CLI::App& app) {
  const auto options = std::make_shared<StudyOptions>();
  CLI::App* study =
      app.add_subcommand("study", "Parameter studies: many cases, on as many cores and machines as there are");
  study->require_subcommand(1);
  CLI::App* make = study->add_subcommand("plan", "Make the cases of a study: a folder each, with all that it needs");
  make->add_option("study", options->study, "Study file (YAML), see docs/studies.md")->required()->type_name("STUDY");
  make->add_option("--out", options->out, "Folder for the study; default out/study-NAME")

      ->type_name("DIR");
  make->callback([options] { plan(*options); });
  const auto addFolder = [&](CLI::App* command) {
    command->add_option("folder", options->folder, "Folder of the planned study")->required()->type_name("DIR");
  };
  CLI::App* work = study->add_subcommand("run", "Run cases that are not done yet; each is the same wherever it runs");
  addFolder(work);
  work->add_option("--case", options->cases, "Only this one; may be given several times")->type_name("N");
  work->add_option("--jobs", options->jobs, "Cases at a time, one thread each; 1: one after the other in this process")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  work->add_flag("--again", options->again, "Cases that are done too");
  work->callback([options] { run(*options); });
  CLI::App* tell =
      study->add_subcommand("report", "Collect the results into a table and a page; exit code 3 if cases are missing");
  addFolder(tell);
  tell->callback([options] { report(*options); });
}

void addSchemaCommand(CLI::App& app) {
  const auto of = std::make_shared<std::string>();
  CLI::App* command =
      app.add_subcommand("schema", "JSON Schema of scene or study files, by which editors complete and check them");
  command->add_option("of", *of, "scene or study")
      ->required()
      ->check(CLI::IsMember({"scene", "study"}))
      ->type_name("NAME");
  command->callback([of] { schema(*of); });
}

}  // namespace palpate
