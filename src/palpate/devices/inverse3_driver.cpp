#include "palpate/devices/inverse3_driver.h"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>

#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <optional>
#include <thread>

#include "palpate/common/error.h"
#include "palpate/devices/inverse3_messages.h"
#include "palpate/devices/web_socket.h"
#include "palpate/haptics/exchange.h"

namespace palpate {
namespace {

using Error = WebSocket::Error;
namespace errc = boost::system::errc;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kWatchdogTime{50};        // without a new wrench: zero
constexpr milliseconds kRetryTime{250};          // between two looks for a device that is away
constexpr std::int64_t kFreshTime = 20'000'000;  // a state is of now for so long [ns]
constexpr double kGateForce = 0.1;               // that must come back before any other is sent [N]
constexpr int kGateAnswers = 40;                 // within so many

std::int64_t now() { return std::chrono::nanoseconds(Clock::now().time_since_epoch()).count(); }

const char* objectionTo(bool powered, bool calibrated, bool ready, bool started) {
  if (!powered) return "the Inverse3 has no power supply";
  if (!calibrated)
    return "the Inverse3 is not calibrated: put it into its rest position, or move it as its service asks";
  if (!started) return "the Inverse3 is not started by its service";
  if (!ready) return "the Inverse3 is not ready";
  return nullptr;
}

struct Settings {
  std::string host, id, preset;
  int port = 0, http_port = 0, events_port = 0;
  double rate = 4000;
};

struct Reading {
  DriverSample sample;
  bool good = false;
  std::int64_t time = 0;  // [ns]
};

struct Wanted {
  Vec3 force = Vec3::Zero();
  std::uint64_t number = 0;
};

class Inverse3Driver final : public DeviceDriver {
 public:
  Inverse3Driver(const Settings& settings, OpenFor purpose) : settings_(settings) {
    version_ = httpGet(settings.host, settings.http_port, "/version");
    version_ = readServiceVersion(version_);
    if (version_.empty() && settings.http_port != 10000 && settings.port == 10001) {
      version_ = readServiceVersion(httpGet(settings.host, 10000, "/version"));
    }
    spelling_ = spellingOf(version_);
    std::string reason = connectService();
    if (!reason.empty()) throw RunError("inverse3: " + reason);
    describe();
    if (purpose == OpenFor::looking) {
      socket_->close();
      return;
    }
    if (const std::string refused = firstForce(); !refused.empty()) throw RunError("inverse3: " + refused);
    info_.facts.emplace_back("spelling of a force", spelling_ == ForceSpelling::vector ? "vector" : "values");
    listenToEvents();
    thread_ = std::thread([this] { exchange(); });
  }
  ~Inverse3Driver() override {
    ending_.store(true);
    if (thread_.joinable()) thread_.join();
  }

  const DriverInfo& info() const noexcept override { return info_; }
  bool read(DriverSample& sample) noexcept override {
    const Reading* newest = readings_.read();
    if (newest == nullptr || !newest->good || now() - newest->time > kFreshTime) return false;
    sample = newest->sample;
    return true;
  }
  void write(const Vec6& wrench) noexcept override { wanted_.write({wrench.head<3>(), ++number_}); }
  void release() noexcept override { released_.store(number_, std::memory_order_relaxed); }
  const char* trouble() const noexcept override { return trouble_.load(std::memory_order_relaxed); }
  std::vector<std::string> notes() const override {
    const std::lock_guard lock(notes_mutex_);
    std::vector<std::string> out;
    for (const auto& [text, count] : notes_)
      out.push_back(count > 1 ? fmt::format("{} ({} times)", text, count) : text);
    return out;
  }

 private:
  // Opening
  // ------------------------------------------------------------------------------------------------------------

  std::string where() const { return fmt::format("{}:{}", settings_.host, settings_.port); }

  // The socket and the inventory. @returns why not, or nothing
  std::string connectService() {
    socket_ = std::make_unique<WebSocket>(sockets_);
    if (const Error error = socket_->open(settings_.host, settings_.port)) {
      std::string out = error == errc::connection_refused
                            ? fmt::format("nothing listens at {}: is the Haply service running?", where())
                            : fmt::format("no connection to {}: {}", where(), error.message());
      if (settings_.port == 10001 && WebSocket(sockets_).open(settings_.host, 10000) == Error()) {
        out =
            fmt::format("the service at {} speaks the legacy format 3.0 on port 10000 only: update it to 3.1 or later",
                        settings_.host);
      }
      return out;
    }
    std::string message;
    if (const Error error = socket_->receive(
            message, [] {}, [] {})) {
      return fmt::format("{} accepts a WebSocket but sends no inventory: {}", where(), error.message());
    }
    const auto inventory = readInverse3Inventory(message);
    if (!inventory)
      return fmt::format(
          "the first message of {} is not of format 3.1 or later; the legacy format 3.0 is not spoken here: "
          "update the Haply service",
          where());
    return choose(*inventory);
  }

  std::string choose(const Inverse3Inventory& inventory) {
    if (inventory.devices.empty()) return fmt::format("the service at {} has no Inverse3: is it plugged in?", where());
    std::string ids;
    const Inverse3Entry* chosen = nullptr;
    for (const Inverse3Entry& entry : inventory.devices) {
      ids += (ids.empty() ? "" : ", ") + entry.id;
      if (settings_.id.empty() || settings_.id == entry.id) chosen = &entry;
    }
    if (chosen == nullptr) return fmt::format("there is no device {}; there are {}", settings_.id, ids);
    if (settings_.id.empty() && inventory.devices.size() > 1) {
      return fmt::format("there are several devices, {}: choose one with inverse3:id={}", ids, chosen->id);
    }
    entry_ = *chosen;
    grip_ = inventory.grip;
    if (entry_.in_use) return fmt::format("{} is in use by another program", entry_.id);
    const char* objection = objectionTo(entry_.powered, entry_.calibrated, entry_.ready, entry_.started);
    return objection ? fmt::format("{}: {}", entry_.id, objection) : std::string();
  }

  // What the vendor does not say is ours, and cautious: see docs/devices.md.
  void describe() {
    const bool small = entry_.type == "minverse";
    info_.name = small ? "Haply Minverse" : "Haply Inverse3";
    info_.serial = entry_.id;
    info_.limits.peak_force = 5.0;
    info_.limits.continuous_force = 2.5;
    info_.limits.peak_torque = 0.0;
    info_.limits.stiffness = 500.0;
    info_.limits.damping = 2.0;
    info_.limits.workspace_radius = small ? 0.04 : 0.10;
    info_.rate = 1000.0;
    info_.facts = entry_.facts;
    info_.facts.emplace_back("service", version_.empty() ? "version not said" : version_);
    info_.facts.emplace_back("grip", grip_.empty() ? "none: no orientation, no buttons" : grip_);
  }

  // The force of the start must come back, or nothing tells whether the service understands ours.
  std::string firstForce() {
    const std::string session = R"({"configure":{"profile":{"name":"org.palpate:run"}}})";
    const std::string configure =
        settings_.preset.empty() ? "" : fmt::format(R"({{"preset":{{"preset":{}}}}})", jsonText(settings_.preset));
    bool first = true;
    for (int attempt = 0; attempt < 2; ++attempt) {
      for (int k = 0; k < kGateAnswers; ++k) {
        if (const auto refused = ask(Vec3(0, 0, kGateForce), first ? session : "", first ? configure : "")) {
          return *refused;
        }
        first = false;
        if (std::abs(state_.force.z() - kGateForce) < 0.2 * kGateForce) {
          const auto refused = ask(Vec3::Zero());
          return refused.value_or("");
        }
      }
      if (const auto refused = ask(Vec3::Zero())) return *refused;
      spelling_ = spelling_ == ForceSpelling::vector ? ForceSpelling::values : ForceSpelling::vector;
    }
    return fmt::format(
        "a force of {} N is asked for and does not come back, spelled \"values\" or \"vector\": no run "
        "without knowing what the device does",
        kGateForce);
  }

  // One exchange while opening. @returns why it failed
  std::optional<std::string> ask(const Vec3& force, const std::string& session = {},
                                 const std::string& configure = {}) {
    std::string answer;
    Error error = socket_->send(inverse3Force(entry_.id, force, spelling_, session, configure));
    if (!error)
      error = socket_->receive(
          answer, [] {}, [this] { letGo(); });
    if (error) return fmt::format("the service at {} ended the exchange: {}", where(), error.message());
    switch (readInverse3State(answer, entry_.id, state_)) {
      case Inverse3Answer::state:
        break;
      case Inverse3Answer::garbage:
        return std::nullopt;  // one message that is cut is no reason
      default:
        return fmt::format("{} is gone", entry_.id);
    }
    if (const char* objection = objectionTo(state_.powered, state_.calibrated, state_.ready, state_.started)) {
      return fmt::format("{}: {}", entry_.id, objection);
    }
    return std::nullopt;
  }

  // E-brake and the like. Without them the run goes on.
  void listenToEvents() {
    events_ = std::make_unique<WebSocket>(sockets_);
    if (events_->open(settings_.host, settings_.events_port)) {
      note(fmt::format("no events at {}:{}: an emergency brake would not be told", settings_.host,
                       settings_.events_port));
      events_.reset();
      return;
    }
    events_->listen([this](std::string_view message) { heard(message); });
  }

  void heard(std::string_view message) {
    const auto event = readInverse3Event(message);
    if (!event || (!event->device.empty() && event->device != entry_.id)) return;
    if (event->safety == "ebrake_triggered") braked_ = true;
    if (event->safety == "ebrake_released") braked_ = false;
    if (event->name == "device-busy") busy_ = true;
    if (event->level != "info" && event->level != "notice") {
      note(fmt::format("{}: {}", event->level, event->safety.empty() ? event->name : event->safety));
    }
  }

  void note(const std::string& text) {
    const std::lock_guard lock(notes_mutex_);
    if (notes_.size() < 100 || notes_.contains(text)) ++notes_[text];
  }

  // The exchange, on its own thread
  // --------------------------------------------------------------------------------------------

  void exchange() {
    sched_param parameters{};  // where it is granted; the tick goes first
    parameters.sched_priority = 70;
    ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
    const auto period = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / settings_.rate));
    auto next = Clock::now();
    for (;;) {
      const bool last = ending_.load();
      const Error error = once();
      if (last) break;
      if (error || returned_) {
        if (error) note(fmt::format("connection lost: {}", error.message()));
        beginAnew();
        next = Clock::now();
        continue;
      }
      next = std::max(next + period, Clock::now() - period);
      std::this_thread::sleep_until(next);
    }
    socket_->close();
    if (events_) events_->cut();
    sockets_.poll();
  }

  // The force for the next message: zero at the end, and when no tick has come for long.
  Vec3 force() {
    if (const Wanted* newest = wanted_.read()) {
      if (newest->number != seen_) {
        seen_ = newest->number;
        seen_time_ = Clock::now();
        newest_ = newest->force;
      }
    }
    const bool stands = Clock::now() - seen_time_ > kWatchdogTime;
    const bool let_go = released_.load(std::memory_order_relaxed) >= seen_;
    const bool away = trouble_.load(std::memory_order_relaxed) != nullptr;
    if (ending_.load() || stands || let_go || away || !newest_.allFinite()) return Vec3::Zero();
    return newest_;
  }

  Error once() {
    if (events_ && events_->ended()) {
      note("the events ended: an emergency brake is not told any more");
      events_.reset();
      if (braked_) return errc::make_error_code(errc::connection_reset);  // nor its release
    }
    while (socket_->hasMore()) {  // one answer for one message: more must not make us lag behind
      note("answers that nobody had asked for");
      if (const Error error = receive()) return error;
    }
    const std::string message = present_ ? inverse3Force(entry_.id, force(), spelling_)
                                         : std::string(R"({"session":{"force_render_full_state":{}}})");
    if (const Error error = socket_->send(message)) return error;
    if (const Error error = receive()) return error;
    if (!present_) std::this_thread::sleep_for(kRetryTime);
    return {};
  }

  // The last word to a service that does not answer, as it may still listen.
  void letGo() { socket_->send(inverse3Force(entry_.id, Vec3::Zero(), spelling_)); }

  Error receive() {
    const auto late = [this] {
      note("answers later than 50 ms");
      tell("the Haply service answers late");
    };
    const Error error = socket_->receive(text_, late, [this] { letGo(); });
    if (error) return error;
    const bool any = settings_.id.empty() && !present_;  // it may come back with another name
    const auto answer = readInverse3State(text_, any ? std::string() : entry_.id, state_);
    if (answer == Inverse3Answer::garbage) {
      note("messages that could not be read");
      return {};
    }
    const bool there = answer == Inverse3Answer::state;
    if (!there && present_) note("unplugged");
    returned_ = there && !present_;  // to settings of its own, which only a new session changes
    present_ = there;
    if (!there) braked_ = false;
    tell(!there || returned_ ? "the Inverse3 was unplugged"
         : busy_             ? "the Inverse3 was taken by another program"
         : braked_           ? "the emergency brake of the Inverse3 is on"
                             : objectionTo(state_.powered, state_.calibrated, state_.ready, state_.started));
    return {};
  }

  // Publishes the state, which is good if nothing is wrong.
  void tell(const char* trouble) {
    trouble_.store(trouble, std::memory_order_relaxed);
    Reading reading;
    reading.sample.pose = {state_.position, state_.rotation};
    reading.sample.twist << state_.velocity, Vec3::Zero();
    reading.sample.buttons = state_.buttons;
    reading.good = trouble == nullptr;
    reading.time = now();
    readings_.write(reading);
  }

  // With a session of its own, as at the start: the device's frame and the spelling of a force are of a session.
  void beginAnew() {
    tell("the connection to the Haply service is lost");
    returned_ = present_ = busy_ = braked_ = false;
    socket_->cut();
    for (;;) {
      const auto again = Clock::now() + kRetryTime;
      while (Clock::now() < again) {
        if (ending_.load()) return;
        std::this_thread::sleep_for(milliseconds(10));
      }
      const Inverse3Entry before = entry_;
      const ForceSpelling spelling = spelling_;
      state_ = {};
      if (connectService().empty() && firstForce().empty()) {
        if (entry_.id != before.id) note(fmt::format("came back as {} in place of {}", entry_.id, before.id));
        note("connected again");
        if (events_) events_->cut();
        listenToEvents();
        present_ = true;
        return;
      }
      entry_ = before;
      spelling_ = spelling;
    }
  }

  Settings settings_;
  DriverInfo info_;
  Inverse3Entry entry_;
  std::string grip_, version_, text_;
  ForceSpelling spelling_ = ForceSpelling::values;
  SocketThread sockets_;
  std::unique_ptr<WebSocket> socket_, events_;
  Inverse3State state_;
  bool present_ = true, returned_ = false, braked_ = false, busy_ = false;
  std::uint64_t number_ = 0, seen_ = 0;
  Clock::time_point seen_time_ = Clock::now();
  Vec3 newest_ = Vec3::Zero();
  LatestValue<Wanted> wanted_;     // tick to exchange
  LatestValue<Reading> readings_;  // back
  std::atomic<std::uint64_t> released_{0};
  std::atomic<const char*> trouble_{nullptr};
  std::atomic<bool> ending_{false};
  mutable std::mutex notes_mutex_;
  std::map<std::string, int> notes_;
  std::thread thread_;
};

}  // namespace

const std::vector<DeviceOption>& inverse3Options() {
  static const std::vector<DeviceOption> options{{"host", "where the service, or a relay to it, answers; localhost"},
                                                 {"port", "of its WebSocket; 10001"},
                                                 {"http_port", "of its HTTP; as port"},
                                                 {"events_port", "of its events; 10020"},
                                                 {"id", "of the device, if there are several"},
                                                 {"preset", "of the device's frame, or none; arm_front_centered"},
                                                 {"rate", "messages a second, 100 to 10000; 4000"}};
  return options;
}

std::shared_ptr<DeviceDriver> openInverse3(const DeviceOptions& options, OpenFor purpose) {
  Settings s;
  s.host = options.text("host", "localhost");
  s.port = static_cast<int>(options.number("port", 10001, 1, 65535));
  s.http_port = static_cast<int>(options.number("http_port", s.port, 1, 65535));
  s.events_port = static_cast<int>(options.number("events_port", 10020, 1, 65535));
  s.id = options.text("id", "");
  s.preset = options.text("preset", "arm_front_centered");
  if (s.preset == "none") s.preset.clear();
  s.rate = options.number("rate", 4000, 100, 10000);
  return std::make_shared<Inverse3Driver>(s, purpose);
}

}  // namespace palpate
