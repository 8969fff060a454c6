#include "palpate/haptics/exchange.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "palpate/haptics/record_queue.h"
#include "palpate/linearization/handle_model.h"

namespace palpate {
namespace {

TEST(LatestValue, HasNothingBeforeTheFirstWrite) {
  LatestValue<int> exchange;
  EXPECT_EQ(exchange.read(), nullptr);
}

TEST(LatestValue, GivesTheNewestAndKeepsIt) {
  LatestValue<int> exchange;
  for (int i = 1; i <= 5; ++i) exchange.write(i);
  ASSERT_NE(exchange.read(), nullptr);
  EXPECT_EQ(*exchange.read(), 5);
  const int* kept = exchange.read();
  exchange.write(6);
  exchange.write(7);
  exchange.write(8);
  EXPECT_EQ(*kept, 5);
  EXPECT_EQ(*exchange.read(), 8);
}

TEST(LatestValue, ModelsAreNeverTornAndNeverGoBack) {
  LatestValue<HandleModel> exchange;
  constexpr int kLast = 100000;
  std::thread writer([&] {
    HandleModel model;
    for (int i = 1; i <= kLast; ++i) {
      model.time = i;
      model.force.setConstant(i);
      model.kx.setConstant(i);
      model.kv.setConstant(i);
      model.handle_twist.setConstant(i);
      exchange.write(model);
    }
  });
  double last = 0.0;
  bool torn = false;
  while (last < kLast) {
    const HandleModel* model = exchange.read();
    if (!model) continue;
    const double i = model->time;
    torn |= i < last || (model->force.array() != i).any() || (model->kx.array() != i).any() ||
            (model->kv.array() != i).any() || (model->handle_twist.array() != i).any();
    last = i;
  }
  writer.join();
  EXPECT_FALSE(torn);
  EXPECT_EQ(last, kLast);
}

TEST(RecordQueue, KeepsOrderAndCountsWhatItDrops) {
  RecordQueue<int> queue(3);
  int value = 0;
  EXPECT_FALSE(queue.pop(value));
  for (int i = 0; i < 5; ++i) EXPECT_EQ(queue.push(i), i < 3);
  EXPECT_EQ(queue.dropped(), 2u);
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(queue.pop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(queue.pop(value));
  EXPECT_TRUE(queue.push(9));
}

TEST(RecordQueue, LosesNothingButWhatItCounts) {
  RecordQueue<std::uint64_t> queue(64);
  constexpr std::uint64_t kCount = 200000;
  std::atomic<bool> done{false};
  std::thread writer([&] {
    for (std::uint64_t i = 0; i < kCount; ++i) queue.push(i);
    done = true;
  });
  std::uint64_t received = 0;
  std::uint64_t next = 0;
  bool ordered = true;
  std::uint64_t value = 0;
  const auto drain = [&] {
    while (queue.pop(value)) {
      ordered &= value >= next;
      next = value + 1;
      ++received;
    }
  };
  while (!done) drain();
  writer.join();
  drain();
  EXPECT_TRUE(ordered);
  EXPECT_GE(received, 64u);  // a full queue has room for as many
  EXPECT_EQ(received + queue.dropped(), kCount);
}

}  // namespace
}  // namespace palpate
