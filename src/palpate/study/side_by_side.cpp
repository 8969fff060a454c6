#include "palpate/study/side_by_side.h"

#include <algorithm>
#include <atomic>
#include <thread>
#include <utility>

#include "palpate/common/parallel.h"

namespace palpate {
namespace {

constexpr int kMostThreads = 2;

}  // namespace

void SideBySide::add(double cost, std::function<void(const Progress&)> work) {
  jobs_.push_back({cost, 0.0, std::move(work), nullptr});
  total_ += cost;
}

void SideBySide::run(const Progress& progress) {
  std::atomic<std::size_t> next{0};
  const auto worker = [&] {
    for (std::size_t i = next++; i < jobs_.size(); i = next++) {
      try {
        jobs_[i].work([&, i](double share) { report(i, share, progress); });
      } catch (...) {
        jobs_[i].failure = std::current_exception();
        next = jobs_.size();  // the rest would be for nothing
      }
    }
  };
  const Executor* executor = Executor::current();
  const int at_once = executor == nullptr ? kMostThreads : std::min(kMostThreads, executor->threads());
  const ExecutorScope alone(nullptr);  // runs side by side need no help within
  std::vector<std::thread> threads;
  for (int k = 1; k < at_once; ++k) threads.emplace_back(worker);
  worker();
  for (std::thread& t : threads) t.join();
  for (const Job& job : jobs_) {
    if (job.failure) std::rethrow_exception(job.failure);
  }
}

void SideBySide::report(std::size_t job, double share, const Progress& progress) {
  const std::lock_guard lock(mutex_);
  jobs_[job].share = share;
  double done = 0;
  for (const Job& j : jobs_) done += j.cost * j.share;
  progress(done / total_);
}

}  // namespace palpate
