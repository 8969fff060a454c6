#pragma once

#include <algorithm>
#include <atomic>
#include <type_traits>
#include <utility>

namespace palpate {

/// Runs the parts of a loop, perhaps on several threads. What is in here knows no threads: they come from outside
/// (threads/thread_team.h), and without them loops run one part after the other.
class Executor {
 public:
  virtual ~Executor() = default;
  /// Calls part(loop, i) once for each i in [0, parts), in any order and on any thread, and returns when all are done.
  /// Rethrows one of the exceptions that parts threw.
  virtual void run(int parts, void (*part)(void* loop, int i), void* loop) = 0;
  /// How many threads may be at work on a loop, the calling one included.
  virtual int threads() const = 0;
  /// Loops are about to come: threads that sleep may get up meanwhile.
  virtual void wake() noexcept {}

  /// Offers a task to a thread that has nothing to do; it may run until revoked() or awaitTask() return. One at a time.
  /// @returns false: there is no such thread, or there is a task already; the caller keeps it
  virtual bool offer(void (* /*task*/)(void* what), void* /*what*/) noexcept { return false; }
  /// Takes the task back. @returns false: a thread is at it or has done it
  virtual bool revoked() noexcept { return true; }
  /// Helps with the task's loops until it is done. Rethrows what it threw.
  virtual void awaitTask() {}
  /// For a task that waits for who offered it: parts of his loops if there are some, else a moment's pause.
  virtual void assist() noexcept {}

  /// That of the calling thread; null: none, or one of its loops is running.
  static Executor* current() noexcept { return current_; }

 private:
  friend class ExecutorScope;
  inline static thread_local Executor* current_ = nullptr;
};

/// While it lives, the calling thread's loops are run by this executor (null: by the thread alone).
class ExecutorScope {
 public:
  explicit ExecutorScope(Executor* executor) noexcept : before_(std::exchange(Executor::current_, executor)) {}
  ~ExecutorScope() { Executor::current_ = before_; }
  ExecutorScope(const ExecutorScope&) = delete;
  ExecutorScope& operator=(const ExecutorScope&) = delete;

 private:
  Executor* before_;
};

/// Where a part of `count` things begins; that of the part after the last one is `count`.
inline int partBegin(int part, int parts, int count) {
  return static_cast<int>(static_cast<long long>(count) * part / parts);
}

/// Calls f(i) for each i in [0, parts), perhaps at the same time. So that results do not depend on the number of
/// threads, parts must be chosen without regard to it, and what they leave must be combined in a fixed order. Loops
/// within a part run in it alone. Allocates nothing.
template <class F>
void parallelFor(int parts, F&& f) {
  Executor* executor = parts > 1 ? Executor::current() : nullptr;
  if (executor == nullptr) {
    for (int i = 0; i < parts; ++i) f(i);
    return;
  }
  using Loop = std::remove_reference_t<F>;
  const ExecutorScope within(nullptr);
  executor->run(
      parts, [](void* loop, int i) { (*static_cast<Loop*>(loop))(i); },
      const_cast<void*>(static_cast<const void*>(&f)));
}

/// A task beside what the calling thread does next, on another thread if one is free: it must not touch what that does.
/// Its loops, and the caller's, are shared out among the threads that are left. Allocates nothing.
template <class F>
class Aside {
 public:
  explicit Aside(F task) : task_(std::move(task)), executor_(Executor::current()) {
    offered_ = executor_ != nullptr && executor_->offer([](void* own) { static_cast<Aside*>(own)->task_(); }, this);
  }
  /// What is not done by now is not wanted: waits for a thread that is at it.
  ~Aside() {
    if (!offered_ || executor_->revoked()) return;
    try {
      executor_->awaitTask();
    } catch (...) {  // as nobody wants the result
    }
  }
  Aside(const Aside&) = delete;
  Aside& operator=(const Aside&) = delete;

  /// Returns when the task is done, which the calling thread does itself where no other has begun. Rethrows what it
  /// threw. At most once.
  void wait() {
    const bool offered = std::exchange(offered_, false);
    if (offered && !executor_->revoked()) {
      executor_->awaitTask();
    } else {
      task_();
    }
  }

 private:
  F task_;
  Executor* executor_;
  bool offered_ = false;
};

/// What a task beside a thread waits for before it goes on. The thread must reach it before it waits for the task.
class Milestone {
  enum class State { ahead, good, bad };

 public:
  /// Reaches it with what f returns, or as failed where f throws.
  template <class F>
  bool reachBy(F&& f) {
    struct Reach {
      std::atomic<State>& state;
      bool good = false;
      ~Reach() { state.store(good ? State::good : State::bad, std::memory_order_release); }
    } reach{state_};
    return reach.good = f();
  }
  /// Helps with the thread's loops meanwhile. @returns whether it was reached well
  bool await() const noexcept {
    for (;;) {
      const State state = state_.load(std::memory_order_acquire);
      if (state != State::ahead) return state == State::good;
      if (Executor* executor = Executor::current()) executor->assist();
    }
  }

 private:
  std::atomic<State> state_{State::ahead};
};

/// Calls f(begin, end), or f(begin, end, part), for `parts` ranges that make up [0, count), as parallelFor() does.
template <class F>
void parallelRanges(int parts, int count, F&& f) {
  parallelFor(parts, [&](int part) {
    const int begin = partBegin(part, parts, count), end = partBegin(part + 1, parts, count);
    if constexpr (std::is_invocable_v<F&, int, int, int>) {
      f(begin, end, part);
    } else {
      f(begin, end);
    }
  });
}

/// Calls f(i) for each i in [0, count), each of which is weight(i) of the work: at the same time where they are of like
/// size, one after the other where one is most of the work, so that its own loops are shared out.
template <class Weight, class F>
void parallelByWeight(int count, Weight&& weight, F&& f) {
  constexpr double kMost = 0.7;
  double all = 0, most = 0;
  for (int i = 0; i < count; ++i) {
    const double own = weight(i);
    all += own;
    most = std::max(most, own);
  }
  if (most > kMost * all) {
    for (int i = 0; i < count; ++i) f(i);
  } else {
    parallelFor(count, f);
  }
}

}  // namespace palpate
