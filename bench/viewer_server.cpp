// What the viewer's server costs: CPU time of its thread, as a share of a core, with viewers that read and answer while
// 60 frames (15 kB with nodes, at 30 Hz; 2 kB without in between) and 60 batches of samples (80 kB/s) go out a second.
#include <benchmark/benchmark.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "palpate/viewer/server.h"
#include "shared/web_client.h"

namespace palpate {
namespace {

Bytes messageOf(char kind, unsigned step, std::size_t size) {
  std::string text(size, '\0');
  text[0] = kind;
  for (std::size_t i = 0; i < 4; ++i) text[8 + i] = static_cast<char>((step >> (8 * i)) & 0xff);
  return std::make_shared<const std::string>(std::move(text));
}

/// Reads until the server goes, and answers every frame.
/// @return frames seen
unsigned watch(unsigned short port) {
  unsigned frames = 0;
  test::SocketClient viewer(port);
  while (true) {
    const auto message = viewer.read();
    if (message.kind == 8) {
      viewer.sendFrame(8, message.data);
      return frames;
    }
    if (message.kind != 2 || message.data[0] != 2) continue;
    unsigned step = 0;
    for (std::size_t i = 0; i < 4; ++i)
      step |= static_cast<unsigned>(static_cast<unsigned char>(message.data[8 + i])) << (8 * i);
    viewer.acknowledge(step);
    ++frames;
  }
}

void serverShare(benchmark::State& state) {
  const auto count = static_cast<std::size_t>(state.range(0));
  for (auto _ : state) {
    Server server({}, {}, "{}", {});
    std::thread loop([&] { server.run(); });
    std::vector<unsigned> frames(count);
    std::vector<std::thread> viewers;
    for (std::size_t i = 0; i < count; ++i) viewers.emplace_back([&, i] { frames[i] = watch(server.port()); });
    while (server.viewers() < static_cast<int>(count)) std::this_thread::yield();
    const double cpu = server.cpuSeconds();
    const auto begin = std::chrono::steady_clock::now();
    constexpr unsigned kPumps = 300;
    for (unsigned i = 0; i < kPumps; ++i) {
      server.samples(messageOf(3, i, 80'000 / 60), 17);
      server.frame(i / 2, messageOf(2, i / 2, 15'000), messageOf(2, i / 2, 2'000));
      std::this_thread::sleep_until(begin + std::chrono::microseconds(16'667) * (i + 1));
    }
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    state.counters["percent_of_a_core"] = 100.0 * (server.cpuSeconds() - cpu) / seconds;
    server.stop();
    loop.join();
    for (auto& viewer : viewers) viewer.join();
    state.counters["frames_per_s"] = frames[0] / seconds;
  }
}

BENCHMARK(serverShare)->Arg(1)->Arg(4)->Arg(16)->Iterations(1)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate
