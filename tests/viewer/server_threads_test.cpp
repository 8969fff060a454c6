#include <gtest/gtest.h>

#include <atomic>
#include <chrono>

#include "running_server.h"
#include "shared/web_client.h"

namespace palpate {
namespace {

using test::bytesOf;
using test::fieldOf;
using test::RunningServer;
using test::sampleBatch;
using test::SocketClient;

// Three threads talk to viewers that come, read, answer and go, while others look at its figures.
TEST(ServerThreads, TakeOrdersFromManyThreads) {
  RunningServer running;
  Server& server = running.server;
  std::atomic<bool> done{false};
  std::atomic<unsigned> frames{0}, batches{0};
  std::vector<std::thread> threads;
  threads.emplace_back([&] {
    for (unsigned i = 0; !done; ++i) {
      if (i % 50 == 0) server.setGreeting({{false, bytesOf("scene")}, {true, bytesOf(std::string(10'000, 'g'))}});
      server.frame(i / 2, bytesOf(std::string(5'000, 'f')), bytesOf("light"));
      server.samples(bytesOf(sampleBatch(i, 16, 0, 1'500)), 16);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  threads.emplace_back([&] {
    while (!done) {
      server.setState(bytesOf("{\"type\":\"state\"}"));
      server.textTo(1 + server.viewers(), bytesOf("{\"type\":\"notice\"}"));
      EXPECT_GE(server.cpuSeconds(), 0.0);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  std::vector<std::thread> viewers;
  for (int v = 0; v < 3; ++v) {
    viewers.emplace_back([&, v] {
      for (int visit = 0; visit < 5; ++visit) {
        SocketClient viewer(server.port());
        for (int i = 0; i < 40; ++i) {
          const auto message = viewer.read();
          if (message.kind == 2 && message.data[0] == 3) ++batches;
          if (message.kind != 2 || (message.data[0] != 'f' && message.data != "light")) continue;
          ++frames;
          for (unsigned step = 0; step < 3; ++step) viewer.acknowledge(step + static_cast<unsigned>(i));
          viewer.send("{\"type\":\"take\"}");
        }
        if (v == 0) viewer.sendFrame(8, "");
      }
    });
  }
  for (auto& viewer : viewers) viewer.join();
  EXPECT_GT(frames, 0u);
  EXPECT_GT(batches, 0u);
  EXPECT_TRUE(running.waitForViewers(0));
  running.stop();  // while orders still come
  const double total = server.cpuSeconds();
  EXPECT_GT(total, 0.0);
  done = true;
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(server.cpuSeconds(), total);
}

}  // namespace
}  // namespace palpate
