#include "palpate/threads/thread_team.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

#include "palpate/common/error.h"

namespace palpate {
namespace {

TEST(PartBegin, CoversEverythingOnce) {
  for (const int count : {0, 1, 5, 64, 1000003}) {
    for (const int parts : {1, 2, 3, 7, 64}) {
      EXPECT_EQ(partBegin(0, parts, count), 0);
      EXPECT_EQ(partBegin(parts, parts, count), count);
      for (int i = 0; i < parts; ++i) {
        const int size = partBegin(i + 1, parts, count) - partBegin(i, parts, count);
        EXPECT_GE(size, count / parts);
        EXPECT_LE(size, count / parts + 1);
      }
    }
  }
}

TEST(ParallelFor, WithoutExecutorRunsInOrderOnTheCaller) {
  std::vector<int> order;
  parallelFor(5, [&](int i) { order.push_back(i); });
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3, 4}));
}

TEST(ParallelRanges, CoverEverythingOnceInParts) {
  for (const int parts : {1, 3, 7}) {
    std::vector<int> count(20, 0), size(static_cast<std::size_t>(parts), 0);
    parallelRanges(parts, 20, [&](int begin, int end) {
      for (int i = begin; i < end; ++i) ++count[static_cast<std::size_t>(i)];
    });
    parallelRanges(parts, 20,
                   [&](int begin, int end, int part) { size[static_cast<std::size_t>(part)] = end - begin; });
    EXPECT_EQ(count, std::vector<int>(20, 1));
    EXPECT_EQ(std::accumulate(size.begin(), size.end(), 0), 20);
    EXPECT_EQ(size.front(), partBegin(1, parts, 20));
  }
}

class Teams : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Threads, Teams, ::testing::Values(1, 2, 4));

TEST_P(Teams, RunsEachPartOnceAndSeesWhatItLeft) {
  ThreadTeam team(GetParam());
  EXPECT_EQ(team.threads(), GetParam());
  const ExecutorScope scope(&team);
  for (const int parts : {0, 1, 2, 3, 17, 1000}) {
    for (int round = 0; round < 50; ++round) {
      std::vector<int> count(static_cast<std::size_t>(parts), 0);
      parallelFor(parts, [&](int i) { ++count[static_cast<std::size_t>(i)]; });
      EXPECT_EQ(count, std::vector<int>(static_cast<std::size_t>(parts), 1));
    }
  }
}

// Loops within a part run in it alone; those of one that is most of the work must not.
TEST_P(Teams, OnlyWorkOfLikeSizeRunsAtTheSameTime) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  const auto sharedOut = [](std::vector<double> weights) {
    std::vector<char> shared(weights.size(), 0);
    parallelByWeight(
        static_cast<int>(weights.size()), [&](int i) { return weights[static_cast<std::size_t>(i)]; },
        [&](int i) { shared[static_cast<std::size_t>(i)] = Executor::current() == nullptr; });
    return shared;
  };
  EXPECT_EQ(sharedOut({1, 1, 1}), (std::vector<char>{1, 1, 1}));
  EXPECT_EQ(sharedOut({2, 1, 0}), (std::vector<char>{1, 1, 1}));
  EXPECT_EQ(sharedOut({1, 8, 1}), (std::vector<char>{0, 0, 0}));
  EXPECT_EQ(sharedOut({}), std::vector<char>());
}

// A thread that is late must not take a part of the next loop for one of the last.
TEST_P(Teams, LoopsThatFollowQuicklyDoNotMix) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  std::vector<long> sum(3, 0);
  constexpr int kLoops = 30000;
  for (int loop = 0; loop < kLoops; ++loop) {
    const long add = loop;
    parallelFor(3, [&sum, add](int i) { sum[static_cast<std::size_t>(i)] += add; });
  }
  const long expected = static_cast<long>(kLoops) * (kLoops - 1) / 2;
  for (const long s : sum) EXPECT_EQ(s, expected);
}

TEST_P(Teams, WakesFromSleep) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 10; ++round) {
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
    if (round % 2 == 0) team.wake();
    std::atomic<int> sum{0};
    parallelFor(100, [&](int i) { sum += i; });
    EXPECT_EQ(sum.load(), 4950);
  }
}

TEST_P(Teams, PartsAreTakenByWhoeverIsFree) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  std::vector<std::thread::id> who(200);
  parallelFor(200, [&](int i) {
    std::this_thread::sleep_for(std::chrono::microseconds(100));
    who[static_cast<std::size_t>(i)] = std::this_thread::get_id();
  });
  std::sort(who.begin(), who.end());
  EXPECT_EQ(std::unique(who.begin(), who.end()) - who.begin(), GetParam());
}

TEST_P(Teams, LoopsWithinPartsRunInThem) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  std::vector<int> sum(8, 0);
  parallelFor(8, [&](int i) {
    const auto own = std::this_thread::get_id();
    EXPECT_EQ(Executor::current(), nullptr);
    parallelFor(10, [&](int j) {
      EXPECT_EQ(std::this_thread::get_id(), own);
      sum[static_cast<std::size_t>(i)] += j;
    });
  });
  EXPECT_EQ(sum, std::vector<int>(8, 45));
  EXPECT_EQ(Executor::current(), &team);
}

TEST_P(Teams, RethrowsAndGoesOn) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 20; ++round) {
    EXPECT_THROW(parallelFor(30,
                             [&](int i) {
                               if (i % 10 == 3) throw std::runtime_error("part");
                             }),
                 std::runtime_error);
    EXPECT_EQ(Executor::current(), &team);
    std::atomic<int> count{0};
    EXPECT_NO_THROW(parallelFor(30, [&](int) { ++count; }));
    EXPECT_EQ(count.load(), 30);
  }
  EXPECT_THROW(parallelFor(ThreadTeam::kMaxParts + 1, [](int) {}), RunError);
}

TEST(Aside, WithoutExecutorRunsWhenItIsWaitedFor) {
  int runs = 0;
  {
    const Aside unwanted([&] { ++runs; });
  }
  EXPECT_EQ(runs, 0);
  Aside wanted([&] { ++runs; });
  EXPECT_EQ(runs, 0);
  wanted.wait();
  EXPECT_EQ(runs, 1);
}

TEST_P(Teams, ATaskAndTheLoopsBesideItRunOnce) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 3000; ++round) {
    std::vector<int> own(20, 0), others(20, 0);
    int runs = 0;
    Aside task([&] {
      for (int k = 0; k < 3; ++k) parallelFor(20, [&](int i) { ++others[static_cast<std::size_t>(i)]; });
      ++runs;
    });
    for (int k = 0; k < 3; ++k) parallelFor(20, [&](int i) { ++own[static_cast<std::size_t>(i)]; });
    task.wait();
    ASSERT_EQ(runs, 1);
    ASSERT_EQ(own, std::vector<int>(20, 3));
    ASSERT_EQ(others, std::vector<int>(20, 3));
    ASSERT_EQ(Executor::current(), &team);
  }
}

TEST_P(Teams, ATaskIsBegunByWhoIsFree) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (const bool asleep : {false, true}) {
    if (asleep) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::atomic<bool> begun{false};
    std::thread::id who;
    Aside task([&] {
      who = std::this_thread::get_id();
      begun = true;
    });
    for (int k = 0; GetParam() > 1 && !begun && k < 10000; ++k) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_EQ(begun, GetParam() > 1);
    task.wait();
    EXPECT_EQ(who == std::this_thread::get_id(), GetParam() == 1);
  }
}

// The second is the caller's.
TEST_P(Teams, OneTaskAtATime) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 500; ++round) {
    std::atomic<int> runs{0};
    std::thread::id who;
    {
      Aside first([&] { ++runs; });
      Aside second([&] {
        ++runs;
        who = std::this_thread::get_id();
      });
      second.wait();
      first.wait();
    }
    ASSERT_EQ(runs, 2);
    ASSERT_EQ(who, std::this_thread::get_id());
  }
}

TEST_P(Teams, WhatATaskThrowsReachesWhoWaits) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 200; ++round) {
    Aside bad([] { throw std::runtime_error("task"); });
    parallelFor(4, [](int) {});
    EXPECT_THROW(bad.wait(), std::runtime_error);
    {
      const Aside unwanted([] { throw std::runtime_error("nobody's"); });
    }
    int runs = 0;
    Aside good([&] { ++runs; });
    EXPECT_NO_THROW(good.wait());
    EXPECT_EQ(runs, 1);
  }
}

// What it works on may be gone.
TEST_P(Teams, ATaskThatNobodyWaitsForIsOverWithItsOwner) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 500; ++round) {
    std::atomic<bool> alive{true}, wrong{false};
    try {
      const Aside task([&] {
        for (int k = 0; k < 50; ++k) wrong = wrong || !alive;
      });
      if (round % 2 == 0) throw std::runtime_error("the caller's");
    } catch (const std::runtime_error&) {
    }
    alive = false;
    EXPECT_FALSE(wrong);
  }
}

// It helps with the loops that lead there.
TEST_P(Teams, ATaskWaitsForAMilestone) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 2000; ++round) {
    std::vector<int> made(30, 0);
    Milestone milestone;
    int seen = -1;
    bool good = false;
    Aside task([&] {
      good = milestone.await();
      seen = std::accumulate(made.begin(), made.end(), 0);
    });
    const bool reached = milestone.reachBy([&] {
      for (int k = 0; k < 3; ++k) parallelFor(30, [&](int i) { ++made[static_cast<std::size_t>(i)]; });
      return round % 2 == 0;
    });
    task.wait();
    ASSERT_EQ(reached, round % 2 == 0);
    ASSERT_EQ(good, reached);
    ASSERT_EQ(seen, 90);
  }
}

TEST_P(Teams, AMilestoneThatIsMissedIsNoHang) {
  ThreadTeam team(GetParam());
  const ExecutorScope scope(&team);
  for (int round = 0; round < 200; ++round) {
    Milestone milestone;
    bool good = true;
    Aside task([&] { good = milestone.await(); });
    EXPECT_THROW(milestone.reachBy([]() -> bool { throw std::runtime_error("on the way"); }), std::runtime_error);
    task.wait();
    EXPECT_FALSE(good);
  }
}

// As the loops of an interactive run do: the page's thread steps while the visual loop stands still.
TEST_P(Teams, ServesOneThreadAfterTheOther) {
  ThreadTeam team(GetParam());
  for (int round = 0; round < 20; ++round) {
    std::vector<int> count(50, 0);
    std::thread asking([&] {
      const ExecutorScope scope(&team);
      for (int k = 0; k < 20; ++k) parallelFor(50, [&](int i) { ++count[static_cast<std::size_t>(i)]; });
    });
    asking.join();
    EXPECT_EQ(std::accumulate(count.begin(), count.end(), 0), 1000);
  }
}

/// Threads of this process.
std::ptrdiff_t threadsAlive() {
  using std::filesystem::directory_iterator;
  return std::distance(directory_iterator("/proc/self/task"), directory_iterator());
}

// Whether they have yet to start, are at work, or sleep: none is left when the team is gone, and each part has run.
TEST(ThreadTeam, EndsWhateverItsThreadsDo) {
  std::thread([] {}).join();  // a sanitizer starts a thread of its own beside the first
  const auto before = threadsAlive();
  for (int round = 0; round < 200; ++round) {
    std::atomic<int> parts{0};
    {
      ThreadTeam team(3);
      const ExecutorScope scope(&team);
      if (round == 0) {
        EXPECT_GE(threadsAlive(), 3);  // the caller is one
      }
      if (round % 3 == 1) parallelFor(4, [&](int) { ++parts; });
      if (round % 3 == 2) std::this_thread::sleep_for(std::chrono::microseconds(20 * round));
    }
    EXPECT_EQ(parts, round % 3 == 1 ? 4 : 0);
  }
  // the kernel takes a moment to forget a thread that has been joined
  for (int i = 0; i < 1000 && threadsAlive() > before; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(threadsAlive(), before);
}

TEST(ThreadTeam, TakesWhatItCan) {
  EXPECT_EQ(ThreadTeam(0).threads(), 1);
  EXPECT_EQ(ThreadTeam(-5).threads(), 1);
  EXPECT_GE(ThreadTeam::suitable(), 1);
  EXPECT_LE(ThreadTeam::suitable(), 4);
}

}  // namespace
}  // namespace palpate
