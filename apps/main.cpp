#include <malloc.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <optional>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "command_line.h"
#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/common/standard_descriptors.h"
#include "palpate/threads/thread_team.h"

namespace {

constexpr int kBadInput = 2;
constexpr int kFailedRun = 1;
constexpr int kFailedChecks = 3;
constexpr int kSignal = 128;  // and its number, as a shell says it

// One line whatever the cause: libraries put line ends into their messages.
int fail(const std::string& message, int code) {
  std::string line = message;
  for (char& c : line) {
    if (c == '\n' || c == '\r') c = ' ';
  }
  std::fprintf(stderr, "palpate: %s\n", line.c_str());
  return code;
}

// What a step frees the next one takes again: given back to the system in between, it would come as fresh pages, whose
// first touch costs more than the step's work on them.
void keepFreedMemory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // the most that is allowed
  mallopt(M_TRIM_THRESHOLD, 512 << 20);
}

/// What standard output does not take, as on a full disk, is a failure of a job that otherwise did well.
/// @param cause  errno of a write that failed; 0: as the flushes say
int end(int code, int cause = 0) {
  palpate::flushOutput();
  if (cause == 0) cause = palpate::output_error;
  if (cause == 0 && std::ferror(stdout) == 0) return code;
  if (cause == EPIPE) return code;  // who reads has read enough

  const std::string why = cause == 0 ? "" : std::string(": ") + std::strerror(cause);  // NOLINT(concurrency-mt-unsafe)
  return fail("cannot write to standard output" + why, kFailedRun);
}

/// No value may be empty: CLI11 would take the default instead. Before the checks that an option has by itself.
void refuseEmptyValues(CLI::App& app) {
  const CLI::Validator not_empty([](const std::string& text) { return text.empty() ? "must not be empty" : ""; }, "");
  for (CLI::Option* option : app.get_options()) {
    if (option->get_items_expected_max() > 0) option->transform(not_empty);
  }
  for (CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) refuseEmptyValues(*command);
}

/// The option of a word `--option=`, whose value CLI11 would take from the next word; empty: there is none.
std::string withoutValue(int argc, char** argv) {
  for (int i = 1; i < argc && std::strcmp(argv[i], "--") != 0; ++i) {
    const std::string word = argv[i];
    if (word.starts_with("--") && word.find('=') == word.size() - 1) return word.substr(0, word.size() - 1);
  }
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (!palpate::openStandardDescriptors()) return kFailedRun;
  palpate::endCleanlyOnSignals();
  keepFreedMemory();
  CLI::App app("Palpate: feel soft things with soft tools. One subcommand a job; each has --help.", "palpate");
  app.fallthrough();  // options of the program may stand behind the subcommand
  int threads = palpate::ThreadTeam::suitable();
  app.add_option(
         "--threads", threads,
         "Threads that work on a visual step; results do not depend on it. Default: by the cores of this machine")
      ->check(CLI::Range(1, palpate::ThreadTeam::kMaxThreads));
  std::optional<palpate::ThreadTeam> team;
  std::optional<palpate::ExecutorScope> scope;
  app.parse_complete_callback([&] {  // before the subcommand's own
    team.emplace(threads);
    scope.emplace(&*team);
  });
  app.set_version_flag("--version", PALPATE_VERSION);
  app.require_subcommand(1);
  palpate::addViewCommand(app);
  palpate::addRunCommand(app);
  palpate::addReplayCommand(app);
  palpate::addExportCommand(app);
  palpate::addOneDCommand(app);
  palpate::addCheckCommand(app);
  palpate::addEvaluateCommand(app);
  palpate::addStressCommand(app);
  palpate::addMeshCommand(app);
  palpate::addValidateCommand(app);
  palpate::addDevicesCommand(app);
  palpate::addLatencyCommand(app);
  palpate::addSoakCommand(app);
  palpate::addStudyCommand(app);
  palpate::addSchemaCommand(app);
  palpate::addManualCommand(app);
  palpate::addCompletionCommand(app);
  if (argc > 1 && std::string(argv[1]) == "complete") {  // asked by shells: what could stand at the cursor?
    const std::vector<std::string> words(argv + 2, argv + argc);
    std::fputs(completionLines(palpate::complete(palpate::describe(app), words)).c_str(), stdout);
    return end(0);
  }
  // CLI11 would only say that a subcommand is required
  const auto known = app.get_subcommands([](const CLI::App*) { return true; });
  if (argc > 1 && argv[1][0] != '-' &&
      std::none_of(known.begin(), known.end(), [&](const CLI::App* c) { return c->get_name() == argv[1]; })) {
    return fail(std::string("there is no subcommand '") + argv[1] + "'; see palpate --help", kBadInput);
  }
  refuseEmptyValues(app);
  if (const std::string name = withoutValue(argc, argv); !name.empty()) {
    return fail(name + ": must not be empty", kBadInput);
  }
  try {
    app.parse(argc, argv);
    return end(0);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) {  // --help, --version
      std::ostringstream text;     // not std::cout: its flush would keep to itself why it failed
      app.exit(e, text, text);
      std::fputs(text.str().c_str(), stdout);
      return end(0);
    }
    return fail(e.what(), kBadInput);
  } catch (const palpate::InputError& e) {
    return fail(e.what(), kBadInput);
  } catch (const palpate::Interrupted& e) {
    return fail(e.what(), kSignal + e.signal());
  } catch (const palpate::ChecksFailed& e) {
    return fail(e.what(), kFailedChecks);
  } catch (const std::system_error& e) {
    if (std::ferror(stdout) != 0 && e.code().value() != EPIPE) return end(kFailedRun, e.code().value());
    return fail(e.what(), kFailedRun);
  } catch (const std::bad_alloc&) {
    return fail("out of memory", kFailedRun);
  } catch (const std::exception& e) {
    return fail(e.what(), kFailedRun);
  }
}
