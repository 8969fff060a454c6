#pragma once

#include <atomic>
#include <cstdint>
#include <exception>
#include <thread>
#include <vector>

#include "palpate/common/parallel.h"

namespace palpate {

/// Threads that run loops together with the thread that asks for it (fork and join), and a task beside it. They take
/// one part after the other, so that one that is held up by the system is not waited for with more than its part. Who
/// has nothing to do looks out for work for a millisecond, and then sleeps. Several threads may ask, one at a time.
class ThreadTeam : public Executor {
 public:
  static constexpr int kMaxThreads = 64;
  static constexpr int kMaxParts = 1 << 15;

  /// @param threads  those that work on a loop, the asking one included; 1: no others. Clamped to [1, kMaxThreads].
  explicit ThreadTeam(int threads);
  ~ThreadTeam() override;
  ThreadTeam(const ThreadTeam&) = delete;
  ThreadTeam& operator=(const ThreadTeam&) = delete;

  /// Cores that the process may use, less one for other threads where there are more than two; at most four.
  static int suitable();

  int threads() const override { return static_cast<int>(workers_.size()) + 1; }
  void run(int parts, void (*part)(void* loop, int i), void* loop) override { own_.run(parts, part, loop); }
  void wake() noexcept override;
  bool offer(void (*task)(void* what), void* what) noexcept override;
  bool revoked() noexcept override;
  void awaitTask() override;

 private:
  // One loop after the other: of the asking thread, or of the task.
  class Loops : public Executor {
   public:
    explicit Loops(ThreadTeam& team) : team_(team) {}
    int threads() const override { return team_.threads(); }
    void run(int parts, void (*part)(void* loop, int i), void* loop) override;
    void assist() noexcept override;
    // Takes parts as long as there are some. @returns whether there was one
    bool help() noexcept;

   private:
    bool takePart(std::uint64_t& ticket) noexcept;
    void finish(int i) noexcept;

    ThreadTeam& team_;
    // Number of the loop, its parts and the next part to take, in one word: who has taken a part knows that it is of
    // the loop whose fields follow, as they cannot change before it is done.
    std::atomic<std::uint64_t> ticket_{0};
    std::atomic<int> done_{0};
    std::atomic<bool> failed_{false};
    void (*part_)(void*, int) = nullptr;
    void* loop_ = nullptr;
    std::exception_ptr failure_;
    unsigned pauses_ = 0;  // of all tasks: may begin anew
  };
  enum class Task { none, offered, taken, done };

  void work() noexcept;
  bool takeTask() noexcept;

  std::atomic<std::uint64_t> calls_{0};  // grows when there is something to do
  Loops own_{*this}, aside_{*this};
  std::atomic<Task> task_state_{Task::none};
  void (*task_)(void*) = nullptr;  // this and what follows: of whom the state says that he may
  void* what_ = nullptr;
  std::exception_ptr failure_;
  std::atomic<bool> stop_{false};
  std::vector<std::thread> workers_;
};

}  // namespace palpate
