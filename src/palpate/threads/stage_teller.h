#pragma once

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

namespace palpate {

/// Says on standard error what a long job is at and for how long: nothing in its first second, then a line a second,
/// after ten seconds one in ten. From a thread of its own, as no part of the job need return in time.
class StageTeller {
 public:
  StageTeller();
  ~StageTeller();
  StageTeller(const StageTeller&) = delete;
  StageTeller& operator=(const StageTeller&) = delete;

  /// What the job does from now on.
  void at(std::string stage);

 private:
  void run();

  std::mutex mutex_;
  std::condition_variable wake_;
  std::string stage_;
  bool ended_ = false;
  std::thread thread_;
};

}  // namespace palpate
