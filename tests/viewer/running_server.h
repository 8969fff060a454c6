#pragma once

#include <condition_variable>
#include <cstring>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/viewer/server.h"

namespace palpate::test {

inline Bytes bytesOf(std::string text) { return std::make_shared<const std::string>(std::move(text)); }

/// A batch of samples as docs/viewer.md has it, as far as the server looks at it.
inline std::string sampleBatch(unsigned number, unsigned ticks, unsigned lost, std::size_t size) {
  std::string batch(std::max<std::size_t>(size, 32), '\0');
  const unsigned header[6] = {3, number, ticks, 0, lost, 0};
  std::memcpy(batch.data(), header, sizeof header);
  return batch;
}

inline unsigned fieldOf(const std::string& message, std::size_t offset) {
  unsigned value = 0;
  std::memcpy(&value, message.data() + offset, sizeof value);
  return value;
}

/// A server in a thread of its own, and what it has said.
class RunningServer {
 public:
  explicit RunningServer(ServerOptions options = {}, const std::string& file = "")
      : server(options, {{"/", "text/html; charset=utf-8", "<p>page"}, {"/app.js", "text/javascript", "1;"}},
               R"({"mode":"view"})", handlers()) {
    if (!file.empty()) server.addFile(file, "/recording");
    thread_ = std::thread([this] { server.run(); });
  }
  ~RunningServer() { stop(); }

  void stop() {
    if (!thread_.joinable()) return;
    server.stop();
    thread_.join();
  }

  /// Waits until the condition, of what the server has said, holds; false after 20 s.
  template <class Condition>
  bool waitFor(Condition condition) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(20), condition);
  }
  bool waitForViewers(std::size_t count) {
    return waitFor([&] { return there.size() == count; });
  }
  bool waitForMessages(std::size_t count) {
    return waitFor([&] { return messages.size() >= count; });
  }

  // under the mutex, for conditions of waitFor()
  std::set<int> there;
  std::vector<int> joined, left;
  std::vector<std::pair<int, std::string>> messages;
  std::vector<std::pair<std::string, std::string>> surfaces;
  bool placed = false;  // what the last surface asked for
  Server server;

 private:
  ServerHandlers handlers() {
    ServerHandlers h;
    h.joined = [this](int viewer) { note([&] { there.insert(viewer), joined.push_back(viewer); }); };
    h.left = [this](int viewer) { note([&] { there.erase(viewer), left.push_back(viewer); }); };
    h.message = [this](int viewer, std::string_view json) { note([&] { messages.emplace_back(viewer, json); }); };
    h.surface = [this](const std::string& name, std::string&& body, bool place) {
      const bool bad = body == "bad";
      note([&] { placed = place; });
      note([&] { surfaces.emplace_back(name, std::move(body)); });
      return bad ? std::optional<std::string>("line 1: no \"surface\"") : std::nullopt;
    };
    return h;
  }

  template <class Action>
  void note(Action action) {
    const std::lock_guard lock(mutex_);
    action();
    changed_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::thread thread_;
};

}  // namespace palpate::test
