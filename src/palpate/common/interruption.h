#pragma once

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstring>
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

struct Provisional {
  std::string path;
  bool whole;  ///< a folder with all that is in it
};

// Never destroyed: a signal may come while the program ends.
inline std::vector<Provisional>& provisional() {
  static auto* paths = new std::vector<Provisional>;
  return *paths;
}

// Removes what is in an open folder. Only system calls: a signal handler must not allocate, and the interrupted thread
// may hold the lock of the heap.
inline void removeContents(int folder, int level = 0) {
  alignas(dirent64) char buffer[2048];
  for (long size; (size = ::syscall(SYS_getdents64, folder, buffer, sizeof buffer)) > 0;) {
    for (long at = 0; at < size;) {
      const auto* entry = reinterpret_cast<const dirent64*>(buffer + at);
      at += entry->d_reclen;
      const char* name = entry->d_name;
      if (std::strcmp(name, ".") == 0 || std::strcmp(name, "..") == 0 || ::unlinkat(folder, name, 0) == 0) continue;
      const int inner = level < 8 ? ::openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC) : -1;
      if (inner < 0) continue;
      removeContents(inner, level + 1);
      ::close(inner);
      ::unlinkat(folder, name, AT_REMOVEDIR);
    }
  }
}

/// @returns whether it is gone now and was there before
inline bool removeProvisional(const Provisional& what) {
  const char* path = what.path.c_str();
  if (::unlink(path) == 0) return true;
  if (what.whole) {
    const int folder = ::open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder >= 0) {
      removeContents(folder);
      ::close(folder);
    }
  }
  return ::rmdir(path) == 0;  // a folder with anything else in it stays
}

// Other threads run on meanwhile, and each can still make the file that it has announced (for the next one it needs
// the lock): they get the time to, and what they made goes too.
inline void removeAllProvisional() {
  const std::vector<Provisional>& paths = provisional();
  for (int quiet = 0, tries = 0; quiet < 3 && tries < 50; ++tries) {
    bool removed = false;
    for (auto path = paths.rbegin(); path != paths.rend(); ++path) removed |= removeProvisional(*path);  // files first
    quiet = removed ? 0 : quiet + 1;
    const timespec pause = {0, 1'000'000};
    if (!paths.empty()) ::nanosleep(&pause, nullptr);
  }
}

inline void handle(int signal) {
  int nobody = 0;
  if (listeners.load() > 0 && asked_by.compare_exchange_strong(nobody, signal)) {
    asked.store(true);
    return;
  }
  while (locked.exchange(true, std::memory_order_acquire)) {
  }
  removeAllProvisional();
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

/// A file, or a folder as far as it is empty, to be removed if a signal ends the program; the latest goes first. To be
/// called before it is made.
/// @param whole  a folder goes with all that is in it
inline void markProvisional(const std::filesystem::path& path, bool whole = false) {
  const UninterruptedScope scope;
  interruption::provisional().push_back({path.string(), whole});
}

/// It stays, or is gone.
inline void unmarkProvisional(const std::filesystem::path& path) {
  const UninterruptedScope scope;
  std::vector<interruption::Provisional>& paths = interruption::provisional();
  const auto at = std::find_if(paths.begin(), paths.end(), [&](const auto& p) { return p.path == path.string(); });
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
