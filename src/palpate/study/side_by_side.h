#pragma once

#include <exception>
#include <functional>
#include <mutex>
#include <vector>

namespace palpate {

/// Jobs that do not depend on each other, and the cost of each for the progress shown; two run at a time, or one where
/// the calling thread's executor has no more threads.
class SideBySide {
 public:
  using Progress = std::function<void(double)>;  ///< takes the share done, 0 to 1
  void add(double cost, std::function<void(const Progress&)> work);
  /// Runs all; of several that fail, the first added throws.
  /// @param progress  called from one thread at a time
  void run(const Progress& progress);

 private:
  struct Job {
    double cost, share;
    std::function<void(const Progress&)> work;
    std::exception_ptr failure;
  };
  void report(std::size_t job, double share, const Progress& progress);

  std::vector<Job> jobs_;
  double total_ = 0;
  std::mutex mutex_;
};

}  // namespace palpate
