#pragma once

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <vector>

namespace palpate {

namespace interruption {

// What a signal handler may touch: it takes the lock, which the interrupted thread never holds as that blocks signals
// meanwhile, and reads what is there.
inline std::atomic<bool> locked = false;
inline thread_local int depth = 0;
// While somebody wants to be asked: the first signal is kept here, and only the next one ends the program.
inline std::atomic<int> listeners = 0;
inline std::atomic<int> asked_by = 0;
inline std::atomic<bool> asked = false;

// Never destroyed: a signal may come while the program ends.
inline std::vector<std::string>& provisional() {
  static auto* paths = new std::vector<std::string>;
  return *paths;
}

inline void handle(int signal) {
  int nobody = 0;
  if (listeners.load() > 0 && asked_by.compare_exchange_strong(nobody, signal)) {
    asked.store(true);
    return;
  }
  while (locked.exchange(true, std::memory_order_acquire)) {
  }
  const std::vector<std::string>& paths = provisional();
  for (auto path = paths.rbegin(); path != paths.rend(); ++path) {  // files before their folders
    if (::unlink(path->c_str()) != 0) ::rmdir(path->c_str());       // a folder with anything else in it stays
  }
  ::signal(signal, SIG_DFL);
  ::raise(signal);  // ends the program as this returns
}

}  // namespace interruption

/// While it lives, signals do not end the program (after endCleanlyOnSignals()), whichever thread they come to: for
/// what is to be done as a whole. May be nested; short.
class UninterruptedScope {
 public:
  UninterruptedScope() {
    sigset_t all;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_BLOCK, &all, &before_);
    if (interruption::depth++ > 0) return;
    while (interruption::locked.exchange(true, std::memory_order_acquire)) {
    }
  }
  ~UninterruptedScope() {
    if (--interruption::depth == 0) interruption::locked.store(false, std::memory_order_release);
    ::pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }
  UninterruptedScope(const UninterruptedScope&) = delete;
  UninterruptedScope& operator=(const UninterruptedScope&) = delete;

 private:
  sigset_t before_;
};

/// A file, or a folder as far as it is empty, to be removed if a signal ends the program; the latest goes first.
inline void markProvisional(const std::filesystem::path& path) {
  const UninterruptedScope scope;
  interruption::provisional().push_back(path.string());
}

/// It stays, or is gone.
inline void unmarkProvisional(const std::filesystem::path& path) {
  const UninterruptedScope scope;
  std::vector<std::string>& paths = interruption::provisional();
  const auto at = std::find(paths.begin(), paths.end(), path.string());
  if (at != paths.end()) paths.erase(at);
}

/// While it lives, the first of the signals below only asks: interruptionAsked() says so, and whoever looks after the
/// job brings it to an end in good order. The next one ends the program as without it.
class InterruptionAsks {
 public:
  InterruptionAsks() { ++interruption::listeners; }
  ~InterruptionAsks() { --interruption::listeners; }
  InterruptionAsks(const InterruptionAsks&) = delete;
  InterruptionAsks& operator=(const InterruptionAsks&) = delete;
};

/// Becomes true when a signal has asked, and stays so.
inline const std::atomic<bool>& interruptionAsked() { return interruption::asked; }
/// Signal that asked; 0: none has.
inline int interruptionSignal() { return interruption::asked_by.load(); }

/// From now on SIGINT (Ctrl-C), SIGTERM and SIGHUP remove what is provisional, then end the program at once as they
/// would by themselves: for a shell with 128 + signal, 130 after Ctrl-C. Those that are ignored stay so.
inline void endCleanlyOnSignals() {
  interruption::provisional();  // made now, not by the handler
  struct sigaction action = {};
  action.sa_handler = interruption::handle;
  ::sigfillset(&action.sa_mask);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction now = {};
    if (::sigaction(signal, nullptr, &now) == 0 && now.sa_handler != SIG_IGN) ::sigaction(signal, &action, nullptr);
  }
}

}  // namespace palpate
