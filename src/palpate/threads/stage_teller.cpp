#include "palpate/threads/stage_teller.h"

#include <chrono>
#include <cstdio>
#include <utility>

namespace palpate {

StageTeller::StageTeller() : thread_([this] { run(); }) {}

StageTeller::~StageTeller() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void StageTeller::at(std::string stage) {
  const std::lock_guard lock(mutex_);
  stage_ = std::move(stage);
}

void StageTeller::run() {
  const auto begin = std::chrono::steady_clock::now();
  std::unique_lock lock(mutex_);
  for (int seconds = 1;; seconds += seconds < 10 ? 1 : 10) {
    wake_.wait_until(lock, begin + std::chrono::seconds(seconds), [this] { return ended_; });
    if (ended_) return;
    if (!stage_.empty()) std::fprintf(stderr, "%s (%d s)\n", stage_.c_str(), seconds);
  }
}

}  // namespace palpate
