#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <new>
#include <optional>
#include <string>
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
    return 0;
  }
  // CLI11 would only say that a subcommand is required
  const auto known = app.get_subcommands([](const CLI::App*) { return true; });
  if (argc > 1 && argv[1][0] != '-' &&
      std::none_of(known.begin(), known.end(), [&](const CLI::App* c) { return c->get_name() == argv[1]; })) {
    return fail(std::string("there is no subcommand '") + argv[1] + "'; see palpate --help", kBadInput);
  }
  try {
    app.parse(argc, argv);
    return 0;
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help, --version
    return fail(e.what(), kBadInput);
  } catch (const palpate::InputError& e) {
    return fail(e.what(), kBadInput);
  } catch (const palpate::Interrupted& e) {
    return fail(e.what(), kSignal + e.signal());
  } catch (const palpate::ChecksFailed& e) {
    return fail(e.what(), kFailedChecks);
  } catch (const std::bad_alloc&) {
    return fail("out of memory", kFailedRun);
  } catch (const std::exception& e) {
    return fail(e.what(), kFailedRun);
  }
}
