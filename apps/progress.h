#pragma once

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <string>

namespace palpate {

/// A line on standard error that says how far a long job is; silent where standard error is not a terminal, except for
/// one line at the start.
class Progress {
 public:
  explicit Progress(std::string what) : what_(std::move(what)), terminal_(isatty(STDERR_FILENO) != 0) {
    std::fprintf(stderr, terminal_ ? "%s   0 %%" : "%s\n", what_.c_str());
  }
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void operator()(double share) {
    if (!terminal_) return;
    const auto now = std::chrono::steady_clock::now();
    if (share < 1.0 && now - last_ < std::chrono::milliseconds(100)) return;
    last_ = now;
    std::fprintf(stderr, "\r%s %3.0f %%", what_.c_str(), 100.0 * share);
    std::fflush(stderr);
  }

 private:
  void clear() {
    if (terminal_) std::fprintf(stderr, "\r%*s\r", static_cast<int>(what_.size()) + 8, "");
  }
  std::string what_;
  bool terminal_;
  std::chrono::steady_clock::time_point last_{};
};

}  // namespace palpate
