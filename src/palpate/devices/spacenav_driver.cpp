#include "palpate/devices/spacenav_driver.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <numbers>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

constexpr std::int32_t kTag = 0x7faa0000, kTagMask = static_cast<std::int32_t>(0xffff0000);
constexpr std::int32_t kProtocol1 = 0x7faa5501;
constexpr int kGreeting = 300;  // for a daemon of version 1 to answer [ms]
constexpr double kFull = 500.0;
constexpr std::size_t kBytes = sizeof(SpacenavPacket);

std::string socketPath(const DeviceOptions& options) {
  if (options.has("socket")) return options.text("socket", "");
  if (const char* given = std::getenv("SPNAV_SOCKET")) return given;  // NOLINT(concurrency-mt-unsafe)
  std::ifstream settings("/etc/spnavrc");
  for (std::string line; std::getline(settings, line);) {
    const std::size_t begin = line.find_first_not_of(" \t"), equals = line.find('=');
    if (begin == std::string::npos || equals == std::string::npos || line.compare(begin, 6, "socket") != 0) continue;
    const std::size_t value = line.find_first_not_of(" \t", equals + 1);
    if (value != std::string::npos) return line.substr(value, line.find_last_not_of(" \t\r") + 1 - value);
  }
  return "/var/run/spnav.sock";
}

class SpacenavDriver final : public DeviceDriver {
 public:
  SpacenavDriver(const DeviceOptions& options, OpenFor purpose)
      : speed_(options.number("speed", 0.1, 0.001, 2)),
        spin_(options.number("spin", 90, 0, 720) * std::numbers::pi / 180),
        dead_zone_(static_cast<int>(options.number("dead_zone", 2, 0, 400))) {
    const std::string path = socketPath(options);
    connectTo(path);
    try {
      greet();
      describe();
    } catch (...) {
      ::close(socket_);
      throw;
    }
    if (purpose == OpenFor::looking) disconnect();
  }
  ~SpacenavDriver() override { disconnect(); }

  const DriverInfo& info() const noexcept override { return info_; }

  bool read(DriverSample& sample) noexcept override {
    take();
    const auto now = std::chrono::steady_clock::now();
    const double dt = begun_ ? std::min(0.05, std::chrono::duration<double>(now - last_).count()) : 0.0;
    last_ = now;
    begun_ = true;
    if (failed_.load(std::memory_order_relaxed)) {
      deflection_.setZero();
      return false;
    }
    twist_ << speed_ * deflection_.head<3>(), spin_ * deflection_.tail<3>();
    pose_ = advance(pose_, dt * twist_);
    sample.pose = pose_;
    sample.twist = twist_;
    sample.buttons = buttons_;
    return true;
  }
  void write(const Vec6&) noexcept override {}
  void release() noexcept override {}
  const char* trouble() const noexcept override {
    return failed() ? "the connection to spacenavd is lost" : trouble_.load(std::memory_order_relaxed);
  }
  bool failed() const noexcept override { return failed_.load(std::memory_order_relaxed); }
  std::vector<std::string> notes() const override {
    return removed_ > 0 ? std::vector<std::string>{fmt::format("unplugged ({} times)", removed_)}
                        : std::vector<std::string>();
  }

 private:
  [[noreturn]] static void refuse(const std::string& why) { throw RunError("spacenavigator: " + why); }

  void connectTo(const std::string& path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (path.size() >= sizeof address.sun_path) refuse("the socket's path is too long: " + path);
    std::copy(path.begin(), path.end(), address.sun_path);
    socket_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (socket_ < 0) refuse(std::strerror(errno));  // NOLINT(concurrency-mt-unsafe)
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      const int why = errno;
      ::close(socket_);
      const std::string hint = why == ENOENT         ? "there is none: is spacenavd installed and running?"
                               : why == ECONNREFUSED ? "nobody listens: is spacenavd running?"
                                                     : std::strerror(why);  // NOLINT(concurrency-mt-unsafe)
      refuse(fmt::format("socket {}: {}", path, hint));
    }
  }
  void disconnect() {
    if (socket_ >= 0) ::close(socket_);
    socket_ = -1;
  }

  // Version 1 answers; version 0 took the number for a sensitivity, and is told the usual one.
  void greet() {
    send(&kProtocol1, sizeof kProtocol1);
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(kGreeting);
    for (auto now = end - std::chrono::milliseconds(kGreeting); now < end; now = std::chrono::steady_clock::now()) {
      SpacenavPacket packet{};
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - now).count();
      if (!receive(packet.data(), sizeof packet[0], static_cast<int>(left))) break;
      if ((packet[0] & kTagMask) == kTag) {
        version_ = packet[0] & 0xff;
        return;
      }
      if (!receive(&packet[1], kBytes - sizeof packet[0], kGreeting)) break;  // an event that was quicker
      handle(packet);
    }
    const float usual = 1.0f;
    send(&usual, sizeof usual);
  }

  void describe() {
    info_.name = "SpaceNavigator or kin";
    info_.has_force = false;
    info_.bounded = false;
    info_.has_velocity = info_.has_spin = true;
    // The simulated device's, for want of any of its own: what the link is made of. Nothing is felt.
    info_.limits.workspace_radius = 10.0;
    info_.facts.emplace_back("protocol", std::to_string(version_));
    if (version_ < 1) return;
    if (const std::string name = askName(); !name.empty()) info_.name = name;
    SpacenavPacket packet{};
    if (ask(0x2004, packet)) info_.facts.emplace_back("USB", fmt::format("{:04x}:{:04x}", packet[1], packet[2]));
    if (ask(0x2003, packet)) info_.facts.emplace_back("buttons", std::to_string(packet[1]));
  }

  // A request and its answer, which comes somewhere between events. @returns whether it was granted
  bool ask(std::int32_t request, SpacenavPacket& packet) {
    packet = {};
    packet[0] = kTag | request;
    send(packet.data(), kBytes);
    return answerTo(kTag | request, packet);
  }
  bool answerTo(std::int32_t type, SpacenavPacket& packet) {
    for (int k = 0; k < 1000; ++k) {
      if (!receive(packet.data(), kBytes, kGreeting)) return false;
      if (packet[0] == type) return packet[7] >= 0;
      handle(packet);
    }
    return false;
  }
  // 24 bytes a packet; the seventh number says how many are left.
  std::string askName() {
    std::string out;
    SpacenavPacket packet{};
    if (!ask(0x2000, packet)) return out;
    for (int k = 0; k < 20; ++k) {
      const std::size_t left = static_cast<std::size_t>(packet[7] & 0xffff);
      char text[24];
      std::memcpy(text, &packet[1], sizeof text);
      out.append(text, strnlen(text, std::min<std::size_t>(left, sizeof text)));
      if (left <= sizeof text || !answerTo(kTag | 0x2000, packet)) break;
    }
    return out;
  }

  void send(const void* bytes, std::size_t size) const {
    if (::send(socket_, bytes, size, MSG_NOSIGNAL) != static_cast<ssize_t>(size))
      refuse("spacenavd ended the connection");
  }
  // @returns whether it came whole within the time [ms]
  bool receive(void* bytes, std::size_t size, int time) const {
    auto* to = static_cast<char*>(bytes);
    for (std::size_t got = 0; got < size;) {
      pollfd wait{socket_, POLLIN, 0};
      if (::poll(&wait, 1, time) <= 0) return false;
      const ssize_t count = ::recv(socket_, to + got, size - got, 0);
      if (count <= 0) refuse("spacenavd ended the connection");
      got += static_cast<std::size_t>(count);
    }
    return true;
  }

  // All that has come, without waiting. Events may come in pieces.
  void take() noexcept {
    for (int k = 0; k < 64 && !failed_.load(std::memory_order_relaxed); ++k) {
      const ssize_t count =
          ::recv(socket_, reinterpret_cast<char*>(pending_.data()) + have_, kBytes - have_, MSG_DONTWAIT);
      if (count == 0 || (count < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
        failed_.store(true, std::memory_order_relaxed);
      }
      if (count <= 0) return;
      have_ += static_cast<std::size_t>(count);
      if (have_ < kBytes) continue;
      have_ = 0;
      handle(pending_);
    }
  }

  void handle(const SpacenavPacket& packet) noexcept {
    switch (packet[0]) {
      case 0:
        deflection_ = spacenavDeflection(packet, dead_zone_);
        return;
      case 1:
      case 2: {
        if (packet[1] < 0 || packet[1] > 31) return;
        const std::uint32_t bit = 1u << packet[1];
        buttons_ = packet[0] == 1 ? buttons_ | bit : buttons_ & ~bit;
        return;
      }
      case 3:  // a device has come or gone; what it last said must not go on
        deflection_.setZero();
        buttons_ = 0;
        if (packet[1] == 1) ++removed_;
        trouble_.store(packet[1] == 1 ? "the SpaceNavigator was unplugged" : nullptr, std::memory_order_relaxed);
        return;
      default:
        return;
    }
  }

  double speed_, spin_;
  int dead_zone_;
  int socket_ = -1, version_ = 0, removed_ = 0;
  DriverInfo info_;
  SpacenavPacket pending_{};
  std::size_t have_ = 0;
  Vec6 deflection_ = Vec6::Zero(), twist_ = Vec6::Zero();
  Pose pose_;
  std::uint32_t buttons_ = 0;
  bool begun_ = false;
  std::chrono::steady_clock::time_point last_;
  std::atomic<bool> failed_{false};
  std::atomic<const char*> trouble_{nullptr};
};

}  // namespace

Vec6 spacenavDeflection(const SpacenavPacket& motion, int dead_zone) {
  const auto value = [&](int k) {
    const std::int32_t raw = motion[static_cast<std::size_t>(k)];
    if (raw >= -dead_zone && raw <= dead_zone) return 0.0;
    return std::clamp(raw / kFull, -1.0, 1.0);
  };
  // right, up, away -> x right, y away, z up; a rotation's vector goes the same way, with the sign of a mirrored frame
  Vec6 out;
  out << value(1), value(3), value(2), value(4), value(6), value(5);
  return out;
}

const std::vector<DeviceOption>& spacenavOptions() {
  static const std::vector<DeviceOption> options{
      {"socket", "of spacenavd; $SPNAV_SOCKET, /etc/spnavrc, /var/run/spnav.sock"},
      {"speed", "at full deflection, m/s, 0.001 to 2; 0.1"},
      {"spin", "at full deflection, degrees/s, 0 to 720; 90"},
      {"dead_zone", "deflection that is none, of 500, 0 to 400; 2"}};
  return options;
}

std::shared_ptr<DeviceDriver> openSpacenav(const DeviceOptions& options, OpenFor purpose) {
  return std::make_shared<SpacenavDriver>(options, purpose);
}

}  // namespace palpate
