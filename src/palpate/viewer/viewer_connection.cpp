#include "palpate/viewer/viewer_connection.h"

#include <fmt/format.h>

#include <boost/asio/buffer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>

#include "palpate/protocol/server_messages.h"

namespace palpate {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using Error = boost::system::error_code;

// Larger messages go in pieces of this size, between which a ping or a close can go.
constexpr std::size_t kFragment = 64 << 10;

class ViewerConnection final : public Connection, public Viewer {
 public:
  ViewerConnection(ServerCore& core, Stream&& stream, http::request<http::empty_body>&& upgrade)
      : Connection(core), socket_(std::move(stream)), upgrade_(std::move(upgrade)) {}

  void start() {
    beast::get_lowest_layer(socket_).expires_never();  // from here on the WebSocket's own time limits hold
    const auto limit = std::chrono::milliseconds(static_cast<long>(1e3 * core_.options.idle_timeout));
    socket_.set_option(websocket::stream_base::timeout{limit, limit, true});
    socket_.set_option(
        websocket::stream_base::decorator([](websocket::response_type& answer) { setSafetyHeaders(answer); }));
    socket_.read_message_max(protocol::kMaxCommandBytes);
    socket_.auto_fragment(true);
    socket_.write_buffer_bytes(kFragment);
    socket_.async_accept(upgrade_, [self = shared()](Error error) { self->onAccept(error); });
  }

  void flush() override {
    if (number_ == 0) return;
    if (queue.overflowing()) return leave(websocket::close_code::policy_error, "too slow");
    if (sending_) return;
    auto message = queue.next();
    if (!message) return;
    sending_ = std::move(message->bytes);
    socket_.binary(message->binary);
    socket_.async_write(asio::buffer(*sending_), [self = shared()](Error error, std::size_t) { self->onSent(error); });
  }

  void finish() override {
    if (accepted_)
      leave(websocket::close_code::going_away, "the server stops");
    else
      cut();
  }

  void cut() override { beast::get_lowest_layer(socket_).close(); }

 private:
  std::shared_ptr<ViewerConnection> shared() { return std::static_pointer_cast<ViewerConnection>(shared_from_this()); }

  void onAccept(Error error) {
    if (error) return;
    accepted_ = true;
    if (core_.stopping) return leave(websocket::close_code::going_away, "the server stops");
    if (core_.viewers.size() >= static_cast<std::size_t>(core_.options.max_viewers)) {
      return leave(websocket::close_code::try_again_later,
                   fmt::format("{} viewers are here already", core_.options.max_viewers));
    }
    number_ = core_.join(*this);
    flush();
    read();
  }

  void read() {
    socket_.async_read(received_, [self = shared()](Error error, std::size_t) { self->onRead(error); });
  }

  void onRead(Error error) {
    if (error) return gone();
    if (number_ == 0) return;  // has been told to go
    if (!socket_.got_text()) return leave(websocket::close_code::unknown_data, "text messages only");
    const auto data = received_.cdata();
    const std::string_view text(static_cast<const char*>(data.data()), data.size());
    if (const auto step = acknowledgedStep(text)) {
      queue.acknowledge(*step);
      flush();
    } else if (core_.handlers.message) {
      core_.handlers.message(number_, text);
    }
    received_.clear();
    if (number_ != 0) read();
  }

  void onSent(Error error) {
    sending_.reset();
    if (error) return gone();
    flush();
  }

  /// Closes with a reason that the page can show; at most 123 bytes go into it.
  void leave(websocket::close_code code, const std::string& reason) {
    deregister();
    if (closing_) return;
    closing_ = true;
    socket_.async_close(websocket::close_reason(code, reason), [self = shared()](Error) { self->cut(); });
  }

  /// The other side has closed, or the connection has failed.
  void gone() {
    deregister();
    if (!closing_) cut();
  }

  void deregister() {
    if (number_ != 0) core_.leave(std::exchange(number_, 0));
  }

  websocket::stream<Stream, false> socket_;  // without permessage-deflate, which costs more time than it saves
  http::request<http::empty_body> upgrade_;
  beast::flat_buffer received_;
  Bytes sending_;   ///< message that is being sent
  int number_ = 0;  ///< 0: not, or no longer, a viewer
  bool accepted_ = false, closing_ = false;
};

}  // namespace

void serveViewer(ServerCore& core, Stream&& stream, http::request<http::empty_body>&& upgrade) {
  std::make_shared<ViewerConnection>(core, std::move(stream), std::move(upgrade))->start();
}

}  // namespace palpate
