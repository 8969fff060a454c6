#pragma once

#include <boost/system/error_code.hpp>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

namespace boost::asio {
class io_context;
}

namespace palpate {

/// The sockets of one thread. What is begun on them goes on while one of them is waited for, or in poll().
class SocketThread {
 public:
  SocketThread();
  ~SocketThread();
  SocketThread(const SocketThread&) = delete;
  SocketThread& operator=(const SocketThread&) = delete;

  boost::asio::io_context& io() { return *io_; }
  void poll();

 private:
  std::unique_ptr<boost::asio::io_context> io_;
};

/// A client's WebSocket with text messages. Everything either ends within a time of its own or is cut.
class WebSocket {
 public:
  using Error = boost::system::error_code;

  explicit WebSocket(SocketThread& thread);
  ~WebSocket();
  WebSocket(const WebSocket&) = delete;
  WebSocket& operator=(const WebSocket&) = delete;

  Error open(const std::string& host, int port);
  Error send(const std::string& message);
  /// @param late      called once if it takes longer than 50 ms
  /// @param given_up  before the connection is cut, as nothing has come for half a second
  Error receive(std::string& message, const std::function<void()>& late, const std::function<void()>& given_up);
  /// Reads again and again, until the socket is cut.
  void listen(const std::function<void(std::string_view)>& heard);
  /// What listens hears no more.
  bool ended() const;
  /// Something has come that nobody has asked for.
  bool hasMore();
  void close();
  void cut();

 private:
  struct Connection;
  std::unique_ptr<Connection> connection_;
};

/// Body of the answer to a GET, or none.
std::string httpGet(const std::string& host, int port, const std::string& path);

}  // namespace palpate
