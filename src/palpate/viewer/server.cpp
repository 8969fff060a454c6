#include "palpate/viewer/server.h"

#include <fmt/format.h>
#include <pthread.h>
#include <time.h>

#include <algorithm>
#include <boost/asio/basic_signal_set.hpp>
#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/ip/v6_only.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <csignal>
#include <fstream>
#include <variant>

#include "palpate/common/error.h"
#include "palpate/protocol/server_messages.h"
#include "palpate/viewer/request_checks.h"
#include "palpate/viewer/server_core.h"
#include "palpate/viewer/server_inbox.h"

namespace palpate {
namespace {

namespace asio = boost::asio;
using Acceptor = asio::basic_socket_acceptor<asio::ip::tcp, Executor>;
using Clock = std::chrono::steady_clock;
using Timer = asio::basic_waitable_timer<Clock, asio::wait_traits<Clock>, Executor>;
using Signals = asio::basic_signal_set<Executor>;
using Error = boost::system::error_code;

constexpr int kMaxOtherConnections = 64;  // beside the viewers
// Small, so that what a stalled viewer does not take waits here, where it can be replaced by something newer.
constexpr int kSendBuffer = 64 << 10;
constexpr auto kGoodbyeTime = std::chrono::milliseconds(800);
constexpr auto kCutTime = std::chrono::milliseconds(200);
constexpr auto kAcceptPause = std::chrono::milliseconds(100);

double secondsOf(clockid_t clock) {
  timespec time{};
  if (clock_gettime(clock, &time) != 0) return -1.0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

std::string bracketed(const asio::ip::address& address) {
  return address.is_v6() ? "[" + address.to_string() + "]" : address.to_string();
}

asio::ip::tcp::endpoint checkedEndpoint(const ServerOptions& options) {
  if (!isAddress(options.address))
    throw InputError("--listen", "",
                     fmt::format("'{}' is not a numeric address such as 192.168.1.7 or ::1", options.address));
  if (!options.token.empty() && !isToken(options.token))
    throw InputError("--token", "", "takes letters, digits and the characters - . _ ~, at most 128 of them");
  if (options.token.empty() && !isLoopbackAddress(options.address))
    throw InputError("--listen", "",
                     fmt::format("{} can be reached from other machines, so it needs --token", options.address));
  return {asio::ip::make_address(options.address), options.port};
}

void bindTo(Acceptor& acceptor, const asio::ip::tcp::endpoint& endpoint) {
  Error error;
  const auto check = [&] {
    if (!error) return;
    const std::string address = bracketed(endpoint.address());
    if (error == asio::error::address_in_use)
      throw InputError("--port", "", fmt::format("{} is in use on {}; 0 takes any free one", endpoint.port(), address));
    if (error == asio::error::access_denied)
      throw InputError("--port", "", fmt::format("{} is not open to this user; take 1024 or more", endpoint.port()));
    if (error.value() == EADDRNOTAVAIL)
      throw InputError("--listen", "", fmt::format("{} is not an address of this machine", address));
    throw InputError("--listen", "", fmt::format("cannot listen on {}: {}", address, error.message()));
  };
  acceptor.open(endpoint.protocol(), error);
  check();
  acceptor.set_option(asio::socket_base::reuse_address(true), error);
  check();
  if (endpoint.protocol() == asio::ip::tcp::v6()) {
    acceptor.set_option(asio::ip::v6_only(false), error);
    check();
  }
  acceptor.bind(endpoint, error);
  check();
  acceptor.listen(asio::socket_base::max_listen_connections, error);
  check();
}

/// What signals did before Asio took them; it forgets that.
class SignalsBefore {
 public:
  SignalsBefore() = default;
  ~SignalsBefore() { giveBack(); }
  SignalsBefore(const SignalsBefore&) = delete;
  SignalsBefore& operator=(const SignalsBefore&) = delete;

  /// @return whether the signal is to be taken
  bool remember(int signal) {
    struct sigaction now = {};
    if (::sigaction(signal, nullptr, &now) != 0) return false;
    if (signal == SIGHUP && now.sa_handler == SIG_IGN) return false;  // nohup
    before_.emplace_back(signal, now);
    return true;
  }
  void giveBack() {
    for (const auto& [signal, action] : before_) ::sigaction(signal, &action, nullptr);
    before_.clear();
  }
  bool empty() const { return before_.empty(); }

 private:
  std::vector<std::pair<int, struct sigaction>> before_;
};

}  // namespace

Connection::Connection(ServerCore& core) : core_(core) { core_.connections.insert(this); }
Connection::~Connection() { core_.connections.erase(this); }

int ServerCore::join(Viewer& viewer) {
  const int number = ++last_viewer;
  viewers.emplace(number, &viewer);
  viewer_count = static_cast<int>(viewers.size());
  viewer.queue.welcome(std::make_shared<std::string>(welcomeMessage(number, options.version)));
  viewer.queue.greet(greeting);
  if (state) viewer.queue.setState(state);
  if (frame) viewer.queue.setFrame(*frame);
  viewer.flush();
  if (handlers.joined) handlers.joined(number);
  return number;
}

void ServerCore::leave(int viewer) {
  if (viewers.erase(viewer) == 0) return;
  viewer_count = static_cast<int>(viewers.size());
  if (handlers.left) handlers.left(viewer);
}

struct Server::Implementation {
  ServerCore core;
  Inbox inbox;
  std::vector<Order> orders;
  // CPU clock of the thread in run(), and what it showed at the beginning; afterwards what run() took in all.
  std::atomic<bool> has_clock{false};
  std::atomic<clockid_t> cpu_clock{};
  std::atomic<double> cpu_start{0.0}, cpu_total{0.0};
  asio::io_context io{1};  // destroyed before what the connections that are still in it use
  Acceptor acceptor{io};
  Timer pause{io}, goodbye{io};
  SignalsBefore signals_before;  // given back after Asio has let go of them
  Signals signals{io};

  void give(Order&& order) {
    if (inbox.add(std::move(order))) asio::post(io, [this] { obey(); });
  }

  void obey() {
    inbox.take(orders);
    for (Order& order : orders) std::visit([this](auto& o) { apply(o); }, order);
    orders.clear();
    for (auto i = core.viewers.begin(); i != core.viewers.end();) (i++)->second->flush();  // it may leave
  }

  template <class Action>
  void forAll(Action action) {
    for (const auto& [number, viewer] : core.viewers) action(viewer->queue);
  }

  void apply(GreetingOrder& order) {
    core.greeting = std::move(order.messages);
    core.frame.reset();
    forAll([&](ViewerQueue& queue) { queue.greet(core.greeting); });
  }
  void apply(StateOrder& order) {
    core.state = std::move(order.json);
    forAll([&](ViewerQueue& queue) { queue.setState(core.state); });
  }
  void apply(TextOrder& order) {
    if (!order.viewer) return forAll([&](ViewerQueue& queue) { queue.text(order.json); });
    const auto found = core.viewers.find(*order.viewer);
    if (found != core.viewers.end()) found->second->queue.text(std::move(order.json));
  }
  void apply(ViewerFrame& frame) {
    forAll([&](ViewerQueue& queue) { queue.setFrame(frame); });
    core.frame = std::move(frame);
  }
  void apply(ViewerSamples& samples) {
    forAll([&](ViewerQueue& queue) { queue.addSamples(samples); });
  }

  void accept() {
    acceptor.async_accept([this](Error error, Socket socket) {
      if (core.stopping) return;
      if (error == asio::error::no_descriptors || error == asio::error::no_buffer_space ||
          error == asio::error::no_memory) {  // some connection has to end first
        pause.expires_after(kAcceptPause);
        pause.async_wait([this](Error) {
          if (!core.stopping) accept();
        });
        return;
      }
      if (!error && core.connections.size() < static_cast<std::size_t>(core.options.max_viewers + kMaxOtherConnections))
        serve(std::move(socket));
      accept();
    });
  }

  void serve(Socket&& socket) {
    Error error;
    socket.set_option(asio::ip::tcp::no_delay(true), error);
    socket.set_option(asio::socket_base::send_buffer_size(kSendBuffer), error);
    serveHttp(core, std::move(socket));
  }

  template <class Action>
  void forAllConnections(Action action) {
    std::vector<std::shared_ptr<Connection>> all;  // held: one may end, and leave the set, while it is dealt with
    for (Connection* connection : core.connections) all.push_back(connection->shared_from_this());
    for (const auto& connection : all) action(*connection);
  }

  void takeSignals() {
    if (!signals_before.empty()) return;
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
      if (signals_before.remember(signal)) signals.add(signal);
    }
    signals.async_wait([this](Error error, int) {
      if (!error) beginStop();
    });
  }

  void beginStop() {
    if (core.stopping) return;
    core.stopping = true;
    Error ignored;
    acceptor.close(ignored);
    pause.cancel();
    signals.clear(ignored);
    signals_before.giveBack();
    if (core.handlers.stopping) core.handlers.stopping();
    obey();  // what was said before stop() goes before the goodbye
    forAllConnections([](Connection& c) { c.finish(); });
    cutWhenLate();
  }

  /// Whoever has not taken leave in time is cut off; should that not end all, run() ends without it.
  void cutWhenLate() {
    goodbye.expires_after(kGoodbyeTime);
    goodbye.async_wait([this](Error) {
      forAllConnections([](Connection& c) { c.cut(); });
      goodbye.expires_after(kCutTime);
      goodbye.async_wait([this](Error) { io.stop(); });
    });
    endWhenAlone();
  }

  /// The timer above must not keep run() once all have gone.
  void endWhenAlone() {
    if (core.connections.empty()) return io.stop();
    pause.expires_after(std::chrono::milliseconds(5));
    pause.async_wait([this](Error) { endWhenAlone(); });
  }

  void startClock() {
    clockid_t clock{};
    if (pthread_getcpuclockid(pthread_self(), &clock) != 0) return;
    cpu_clock = clock;
    cpu_start = secondsOf(clock);
    has_clock = true;
  }

  void stopClock() {
    if (!has_clock) return;
    cpu_total = secondsOf(cpu_clock) - cpu_start;
    has_clock = false;
  }
};

Server::Server(const ServerOptions& options, std::vector<StaticFile> files, std::string session_json,
               ServerHandlers handlers)
    : implementation_(std::make_unique<Implementation>()) {
  Implementation& self = *implementation_;
  bindTo(self.acceptor, checkedEndpoint(options));
  self.core.options = options;
  self.core.port = self.acceptor.local_endpoint().port();
  self.core.cookie_name = fmt::format("palpate-{}", self.core.port);
  for (StaticFile& file : files) {
    std::string path = file.path;
    self.core.files.insert_or_assign(std::move(path), std::move(file));
  }
  self.core.session_json = std::move(session_json);
  self.core.handlers = std::move(handlers);
}

Server::~Server() = default;

unsigned short Server::port() const { return implementation_->core.port; }

std::string Server::url() const {
  const ServerOptions& options = implementation_->core.options;
  auto address = asio::ip::make_address(options.address);
  if (address.is_unspecified()) {
    address = address.is_v6() ? asio::ip::address(asio::ip::address_v6::loopback())
                              : asio::ip::address(asio::ip::address_v4::loopback());
  }
  return fmt::format("http://{}:{}/{}{}", bracketed(address), port(),
                     options.token.empty() ? "" : "?token=", options.token);
}

void Server::addFile(const std::string& file, const std::string& url_path, const std::string& content_type) {
  if (!std::ifstream(file)) throw InputError(file, "", "cannot be read");
  implementation_->core.disk_files.insert_or_assign(url_path, DiskFile{file, content_type});
}

void Server::stopOnSignals() { implementation_->takeSignals(); }

void Server::run() {
  Implementation& self = *implementation_;
  if (self.core.options.stop_on_signals) self.takeSignals();
  struct Ending {
    Implementation& self;
    ~Ending() {
      self.inbox.close();
      self.stopClock();
    }
  } ending{self};
  self.startClock();
  self.accept();
  self.io.run();
  // Where the goodbye took too long, viewers are left that nobody was told of.
  while (!self.core.viewers.empty()) self.core.leave(self.core.viewers.begin()->first);
}

void Server::stop() {
  asio::post(implementation_->io, [self = implementation_.get()] { self->beginStop(); });
}

void Server::setGreeting(std::vector<std::pair<bool, Bytes>> messages) {
  std::erase_if(messages, [](const auto& message) { return !message.second; });
  implementation_->give(GreetingOrder{std::move(messages)});
}

void Server::setState(Bytes json) {
  if (json) implementation_->give(StateOrder{std::move(json)});
}

void Server::text(Bytes json) {
  if (json) implementation_->give(TextOrder{std::move(json), std::nullopt});
}

void Server::textTo(int viewer, Bytes json) {
  if (json) implementation_->give(TextOrder{std::move(json), viewer});
}

void Server::frame(unsigned step, Bytes full, Bytes light) {
  if (full) implementation_->give(ViewerFrame{step, std::move(full), std::move(light)});
}

void Server::samples(Bytes batch, unsigned ticks) {
  if (batch) implementation_->give(ViewerSamples{std::move(batch), ticks});
}

int Server::viewers() const { return implementation_->core.viewer_count; }

double Server::cpuSeconds() const {
  const Implementation& self = *implementation_;
  if (self.has_clock) {
    const double now = secondsOf(self.cpu_clock);
    if (now >= 0.0) return now - self.cpu_start;  // negative where the thread has just ended
  }
  return self.cpu_total;
}

}  // namespace palpate
