#include "palpate/viewer/viewer_queue.h"

#include <gtest/gtest.h>

#include <chrono>

#include "running_server.h"

namespace palpate {
namespace {

using test::bytesOf;
using test::fieldOf;
using test::sampleBatch;

/// The next message, or "-" where none may go.
std::string nextOf(ViewerQueue& queue) {
  const auto message = queue.next();
  return message ? *message->bytes : "-";
}

ViewerFrame frameOf(unsigned step, const std::string& name) {
  return {step, bytesOf(name + " full"), bytesOf(name + " light")};
}

ViewerSamples batchOf(unsigned number, unsigned ticks, std::size_t size, unsigned lost = 0) {
  return {bytesOf(sampleBatch(number, ticks, lost, size)), ticks};
}

TEST(ViewerQueue, SendsGreetingStateAndTextsBeforeFrames) {
  ViewerQueue queue;
  queue.greet({{false, bytesOf("scene")}, {true, bytesOf("geometry")}});
  queue.setFrame(frameOf(1, "a"));
  queue.text(bytesOf("notice"));
  queue.setState(bytesOf("old state"));
  queue.setState(bytesOf("state"));
  queue.welcome(bytesOf("welcome"));
  EXPECT_EQ(nextOf(queue), "welcome");
  const auto scene = queue.next(), geometry = queue.next();
  EXPECT_FALSE(scene->binary);
  EXPECT_TRUE(geometry->binary);
  EXPECT_EQ(*geometry->bytes, "geometry");
  EXPECT_EQ(nextOf(queue), "state");
  EXPECT_EQ(nextOf(queue), "notice");
  EXPECT_EQ(nextOf(queue), "a full");
  EXPECT_EQ(nextOf(queue), "-");
}

TEST(ViewerQueue, SendsTheNewestFrameOnlyAndNodesOnce) {
  ViewerQueue queue;
  queue.setFrame(frameOf(1, "a"));
  queue.setFrame(frameOf(2, "b"));
  EXPECT_EQ(nextOf(queue), "b full");
  queue.setFrame(frameOf(2, "c"));
  EXPECT_EQ(nextOf(queue), "c light");
  queue.setFrame({2, bytesOf("no light one"), nullptr});
  EXPECT_EQ(nextOf(queue), "no light one");
}

TEST(ViewerQueue, SendsNoFrameWhileThreeAreOnTheWay) {
  ViewerQueue queue;
  for (const unsigned step : {1u, 2u, 2u}) {
    queue.setFrame(frameOf(step, "a"));
    EXPECT_NE(nextOf(queue), "-");
  }
  queue.setFrame(frameOf(3, "b"));
  EXPECT_EQ(nextOf(queue), "-");
  queue.acknowledge(7);  // never sent
  EXPECT_EQ(nextOf(queue), "-");
  queue.acknowledge(1);
  queue.setFrame(frameOf(4, "c"));
  EXPECT_EQ(nextOf(queue), "c full");
  queue.setFrame(frameOf(5, "d"));
  EXPECT_EQ(nextOf(queue), "-");
  queue.acknowledge(4);  // and all before it
  for (const unsigned step : {5u, 6u, 7u}) {
    queue.setFrame(frameOf(step, "e"));
    EXPECT_EQ(nextOf(queue), "e full");
  }
  queue.setFrame(frameOf(8, "f"));
  EXPECT_EQ(nextOf(queue), "-");
}

TEST(ViewerQueue, FramesDoNotWaitBehindSamplesNorTheOtherWayRound) {
  ViewerQueue queue;
  for (unsigned i = 0; i < 4; ++i) queue.addSamples(batchOf(i, 1, 100));
  queue.setFrame(frameOf(1, "a"));
  EXPECT_EQ(nextOf(queue), "a full");
  queue.setFrame(frameOf(2, "b"));
  EXPECT_EQ(fieldOf(nextOf(queue), 4), 0u);
  EXPECT_EQ(nextOf(queue), "b full");
  for (unsigned i = 1; i < 4; ++i) EXPECT_EQ(fieldOf(nextOf(queue), 4), i);
}

TEST(ViewerQueue, CountsDroppedSamplesForThisViewerOnly) {
  ViewerQueue queue(350);
  std::vector<ViewerSamples> batches;
  for (unsigned i = 0; i < 6; ++i) batches.push_back(batchOf(i, 10 + i, 100, i == 1 ? 1000 : 0));
  batches.push_back(batchOf(6, 16, 100, 5));
  for (const auto& batch : batches) queue.addSamples(batch);
  EXPECT_LE(queue.waitingSampleBytes(), 350u);
  const std::string first = nextOf(queue);
  EXPECT_EQ(fieldOf(first, 4), 4u);
  EXPECT_EQ(fieldOf(first, 16), 10u + 11u + 12u + 13u + 1000u);
  EXPECT_EQ(first.size(), 100u);
  EXPECT_EQ(fieldOf(*batches[4].bytes, 16), 0u);  // what others get
  EXPECT_EQ(fieldOf(nextOf(queue), 16), 0u);
  EXPECT_EQ(fieldOf(nextOf(queue), 16), 5u);  // was in it
  EXPECT_EQ(nextOf(queue), "-");
}

TEST(ViewerQueue, DropsABatchThatIsLargerThanAllMayBe) {
  ViewerQueue queue(350);
  queue.addSamples(batchOf(0, 7, 1000));
  EXPECT_EQ(nextOf(queue), "-");
  queue.addSamples(batchOf(1, 1, 40));
  EXPECT_EQ(fieldOf(nextOf(queue), 16), 7u);
  queue.addSamples({bytesOf("short"), 1});  // nothing to patch in it
  queue.addSamples({bytesOf(std::string(1000, 'x')), 1});
  queue.addSamples({bytesOf("short"), 1});
  EXPECT_EQ(nextOf(queue), "short");
}

TEST(ViewerQueue, ForgetsFramesAndSamplesOfTheGenerationBefore) {
  ViewerQueue queue(350);
  for (unsigned step = 1; step <= 3; ++step) {
    queue.setFrame(frameOf(step, "a"));
    EXPECT_EQ(nextOf(queue), "a full");
  }
  for (unsigned i = 0; i < 6; ++i) queue.addSamples(batchOf(i, 10, 100));
  queue.setFrame(frameOf(3, "b"));
  queue.greet({{false, bytesOf("scene 2")}});
  queue.addSamples(batchOf(9, 1, 100));
  queue.setFrame(frameOf(3, "c"));
  EXPECT_EQ(nextOf(queue), "scene 2");
  const std::string first = nextOf(queue), second = nextOf(queue);
  const std::string& samples = first == "c full" ? second : first;
  EXPECT_TRUE(first == "c full" || second == "c full");
  EXPECT_EQ(fieldOf(samples, 4), 9u);
  EXPECT_EQ(fieldOf(samples, 16), 0u);
}

TEST(ViewerQueue, CompletesAGreetingThatHasBegun) {
  ViewerQueue queue;
  queue.greet({{false, bytesOf("scene 1")}, {true, bytesOf("geometry 1")}});
  EXPECT_EQ(nextOf(queue), "scene 1");
  queue.greet({{false, bytesOf("scene 2")}, {true, bytesOf("geometry 2")}});
  queue.greet({{false, bytesOf("scene 3")}, {true, bytesOf("geometry 3")}});
  EXPECT_EQ(nextOf(queue), "geometry 1");
  EXPECT_EQ(nextOf(queue), "scene 3");
  EXPECT_EQ(nextOf(queue), "geometry 3");
  EXPECT_EQ(nextOf(queue), "-");
}

TEST(ViewerQueue, SaysWhenTooMuchTextWaits) {
  ViewerQueue queue;
  for (int i = 0; i < 4; ++i) queue.text(bytesOf(std::string(1 << 20, 'x')));
  EXPECT_FALSE(queue.overflowing());
  queue.text(bytesOf("x"));
  EXPECT_TRUE(queue.overflowing());
  queue.next();
  EXPECT_FALSE(queue.overflowing());
}

}  // namespace
}  // namespace palpate
