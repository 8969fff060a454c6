#include "palpate/devices/web_socket.h"

#include <array>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <deque>
#include <memory>
#include <type_traits>
#include <utility>

namespace palpate {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using Error = WebSocket::Error;
using Tcp = asio::ip::tcp;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kConnectTime{2000};
constexpr milliseconds kLateTime{50};     // an answer later than this is late
constexpr milliseconds kAnswerTime{500};  // one that has not come by now never will

/// What is to be done when an operation on a socket has ended, whatever that is: Beast has a type of its own for each,
/// and all of Asio would be compiled for each of them.
class Handler {
 public:
  template <typename Own>
  explicit Handler(Own&& own) : held_(std::make_unique<HeldAs<std::decay_t<Own>>>(std::forward<Own>(own))) {}
  void operator()(Error error, std::size_t bytes = 0) { std::exchange(held_, nullptr)->run(error, bytes); }

 private:
  struct Held {
    virtual ~Held() = default;
    virtual void run(Error error, std::size_t bytes) = 0;
  };
  template <typename Own>
  struct HeldAs final : Held {
    explicit HeldAs(Own&& value) : own(std::move(value)) {}
    explicit HeldAs(const Own& value) : own(value) {}
    void run(Error error, std::size_t bytes) override {
      Own last = std::move(own);
      if constexpr (std::is_invocable_v<Own&, Error, std::size_t>) {
        last(error, bytes);
      } else {
        last(error);
      }
    }
    Own own;
  };
  std::unique_ptr<Held> held_;
};

// Names that Asio and Beast ask for. NOLINTBEGIN(readability-identifier-naming)

/// The first few of any sequence of buffers, for the same reason.
template <typename Buffer>
class Buffers {
 public:
  using value_type = Buffer;
  using const_iterator = const Buffer*;

  template <typename Sequence>
  explicit Buffers(const Sequence& sequence) {
    const auto last = asio::buffer_sequence_end(sequence);
    for (auto it = asio::buffer_sequence_begin(sequence); it != last && count_ < items_.size(); ++it) {
      const Buffer buffer(*it);
      if (buffer.size() > 0) items_[count_++] = buffer;
    }
  }
  const_iterator begin() const { return items_.data(); }
  const_iterator end() const { return items_.data() + count_; }

 private:
  std::array<Buffer, 8> items_{};
  std::size_t count_ = 0;
};

/// The socket as Beast sees it.
class Wire {
 public:
  using executor_type = asio::io_context::executor_type;
  using Socket = asio::basic_stream_socket<Tcp, executor_type>;

  explicit Wire(asio::io_context& io) : socket_(io) {}
  executor_type get_executor() noexcept { return socket_.get_executor(); }
  Socket& socket() { return socket_; }
  void close() {
    Error ignored;
    socket_.close(ignored);
  }

  template <typename Sequence, typename Own>
  void async_read_some(const Sequence& buffers, Own&& handler) {
    read(Buffers<asio::mutable_buffer>(buffers), Handler(std::forward<Own>(handler)));
  }
  template <typename Sequence, typename Own>
  void async_write_some(const Sequence& buffers, Own&& handler) {
    write(Buffers<asio::const_buffer>(buffers), Handler(std::forward<Own>(handler)));
  }
  void finish(beast::role_type role, Handler handler) { websocket::async_teardown(role, socket_, std::move(handler)); }

 private:
  void read(const Buffers<asio::mutable_buffer>& buffers, Handler handler) {
    socket_.async_read_some(buffers, std::move(handler));
  }
  void write(const Buffers<asio::const_buffer>& buffers, Handler handler) {
    socket_.async_write_some(buffers, std::move(handler));
  }

  Socket socket_;
};

// What Beast asks of a socket that is not its own.
[[maybe_unused]] void beast_close_socket(Wire& wire) { wire.close(); }
template <typename Own>
void async_teardown(beast::role_type role, Wire& wire, Own&& handler) {
  wire.finish(role, Handler(std::forward<Own>(handler)));
}

// NOLINTEND(readability-identifier-naming)

/// Notes that an operation has ended, and how.
struct Done {
  bool* done;
  Error* result;
  template <typename... More>
  void operator()(Error error, const More&... /*more*/) const {
    *done = true;
    *result = error;
  }
};

bool waitUntil(asio::io_context& io, const bool& done, Clock::time_point deadline) {
  io.restart();
  while (!done && io.run_one_until(deadline) > 0) {
  }
  if (!done) io.poll();  // a process that stood still finds the time over, and what it waits for there
  return done;
}

/// @param start  begins an operation with the handler it is given; it is cut when it takes longer than this
template <typename Start>
Error wait(asio::io_context& io, Wire& wire, milliseconds time, Start&& start) {
  bool done = false;
  Error result;
  start(Done{&done, &result});
  if (waitUntil(io, done, Clock::now() + time)) return result;
  wire.close();
  waitUntil(io, done, Clock::now() + milliseconds(1000));
  return asio::error::timed_out;
}

Error connect(asio::io_context& io, Wire& wire, const std::string& host, int port) {
  Tcp::resolver resolver(io);
  Error error;
  const auto found = resolver.resolve(host, std::to_string(port), error);
  if (error) return error;
  error = wait(io, wire, kConnectTime, [&](Done done) { asio::async_connect(wire.socket(), found, done); });
  if (!error) wire.socket().set_option(Tcp::no_delay(true), error);
  return error;
}

/// Outlives the socket as long as a read is under way.
struct Inbox {
  std::deque<std::string> messages;
  Error error;
  bool ready = false;  // there is a message or an error
  bool alive = true;
};

}  // namespace

std::string httpGet(const std::string& host, int port, const std::string& path) {
  asio::io_context io;
  Wire wire(io);
  if (connect(io, wire, host, port)) return {};
  http::request<http::empty_body> request(http::verb::get, path, 11);
  request.set(http::field::host, host);
  if (wait(io, wire, kConnectTime, [&](Done done) { http::async_write(wire, request, done); })) return {};
  beast::flat_buffer buffer(1 << 16);
  http::response<http::string_body> answer;
  if (wait(io, wire, kConnectTime, [&](Done done) { http::async_read(wire, buffer, answer, done); })) return {};
  return answer.result() == http::status::ok ? answer.body() : std::string();
}

SocketThread::SocketThread() : io_(std::make_unique<asio::io_context>()) {}
SocketThread::~SocketThread() = default;
void SocketThread::poll() {
  io_->restart();
  io_->poll();
}

struct WebSocket::Connection {
  explicit Connection(SocketThread& of) : thread(of), stream(of.io()) {}
  Wire& wire() { return stream.next_layer(); }

  SocketThread& thread;
  websocket::stream<Wire, false> stream;  // without compression, which nobody here asks for
  beast::flat_buffer buffer;
  std::shared_ptr<Inbox> inbox = std::make_shared<Inbox>();
  bool reading = false;
};

WebSocket::WebSocket(SocketThread& thread) : connection_(std::make_unique<Connection>(thread)) {}
WebSocket::~WebSocket() { connection_->inbox->alive = false; }

Error WebSocket::open(const std::string& host, int port) {
  Connection& c = *connection_;
  if (const Error error = connect(c.thread.io(), c.wire(), host, port)) return error;
  c.stream.set_option(websocket::stream_base::timeout{kConnectTime, websocket::stream_base::none(), false});
  c.stream.read_message_max(1 << 20);
  c.stream.text(true);
  return wait(c.thread.io(), c.wire(), kConnectTime,
              [&](Done done) { c.stream.async_handshake(host + ":" + std::to_string(port), "/", done); });
}

Error WebSocket::send(const std::string& message) {
  Connection& c = *connection_;
  return wait(c.thread.io(), c.wire(), kAnswerTime,
              [&](Done done) { c.stream.async_write(asio::buffer(message), done); });
}

Error WebSocket::receive(std::string& message, const std::function<void()>& late,
                         const std::function<void()>& given_up) {
  Connection& c = *connection_;
  Inbox& inbox = *c.inbox;
  if (!c.reading) {  // from now on always, so that what comes unasked shows
    c.reading = true;
    listen([&inbox](std::string_view text) {
      inbox.messages.emplace_back(text);
      inbox.ready = true;
    });
  }
  const auto begin = Clock::now();
  if (!waitUntil(c.thread.io(), inbox.ready, begin + kLateTime)) {
    late();
    if (!waitUntil(c.thread.io(), inbox.ready, begin + kAnswerTime)) {
      given_up();
      cut();
      return asio::error::timed_out;
    }
  }
  if (inbox.messages.empty()) return inbox.error;
  message = std::move(inbox.messages.front());
  inbox.messages.pop_front();
  inbox.ready = !inbox.messages.empty() || inbox.error;
  return {};
}

void WebSocket::listen(const std::function<void(std::string_view)>& heard) {
  Connection& c = *connection_;
  c.stream.async_read(c.buffer, [this, heard, inbox = c.inbox](Error error, std::size_t) {
    if (!inbox->alive) return;
    if (error) {
      inbox->error = error;
      inbox->ready = true;
      return;
    }
    beast::flat_buffer& buffer = connection_->buffer;
    heard(std::string_view(static_cast<const char*>(buffer.data().data()), buffer.size()));
    buffer.clear();
    listen(heard);
  });
}

bool WebSocket::ended() const { return connection_->inbox->error.failed(); }

bool WebSocket::hasMore() {
  connection_->thread.poll();
  return !connection_->inbox->messages.empty();
}

void WebSocket::close() {
  Connection& c = *connection_;
  wait(c.thread.io(), c.wire(), milliseconds(200),
       [&](Done done) { c.stream.async_close(websocket::close_code::normal, done); });
}

void WebSocket::cut() { connection_->wire().close(); }

}  // namespace palpate
