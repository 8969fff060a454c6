#pragma once

// A browser's side of the viewer's connection, on plain sockets.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace palpate::test {

/// A TCP connection that waits at most some seconds for anything. Written on plain sockets, so that it shares no code,
/// and no misunderstanding of HTTP, with the server.
class TcpClient {
 public:
  /// @param receive_buffer  bytes that the kernel may keep for it; 0: as it likes
  explicit TcpClient(unsigned short port, int receive_buffer = 0) : fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int on = 1;
    ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (receive_buffer > 0) ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    if (fd_ < 0 || ::connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
      close();
      throw std::runtime_error("cannot connect");
    }
  }
  TcpClient(TcpClient&& other) noexcept
      : fd_(std::exchange(other.fd_, -1)), received_(std::move(other.received_)), ended_(other.ended_) {}
  TcpClient& operator=(TcpClient&&) = delete;
  ~TcpClient() { close(); }

  void close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  }

  /// @return false where the other side does not take it any more
  bool send(const std::string& bytes) {
    std::size_t sent = 0;
    while (sent < bytes.size()) {
      const ssize_t n = ::send(fd_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (n <= 0) return false;
      sent += static_cast<std::size_t>(n);
    }
    return true;
  }

  /// The next bytes, exactly so many.
  std::string take(std::size_t bytes) {
    while (received_.size() - taken_ < bytes)
      if (!receive()) throw std::runtime_error("the connection ended early");
    std::string result = received_.substr(taken_, bytes);
    taken_ += bytes;
    if (taken_ > (1u << 20) || taken_ == received_.size()) {
      received_.erase(0, taken_);
      taken_ = 0;
    }
    return result;
  }

  /// Up to and including `end`.
  std::string takeUntil(const std::string& end) {
    while (true) {
      const std::size_t at = received_.find(end, taken_);
      if (at != std::string::npos) return take(at + end.size() - taken_);
      if (!receive()) throw std::runtime_error("the connection ended early");
    }
  }

  /// True if the other side closes, and sends nothing before that.
  bool endsNow() { return received_.size() == taken_ && !receive(); }

  /// True if something has come, or comes within that time.
  bool hasData(int milliseconds) {
    pollfd poll{fd_, POLLIN, 0};
    return received_.size() > taken_ || ::poll(&poll, 1, milliseconds) > 0;
  }

 private:
  bool receive() {
    if (ended_) return false;
    pollfd poll{fd_, POLLIN, 0};
    if (::poll(&poll, 1, 20'000) <= 0) throw std::runtime_error("nothing came for 20 s");
    char buffer[65536];
    const ssize_t n = ::recv(fd_, buffer, sizeof buffer, 0);
    ended_ = n <= 0;
    if (n > 0) received_.append(buffer, static_cast<std::size_t>(n));
    return n > 0;
  }

  int fd_;
  std::string received_;
  std::size_t taken_ = 0;
  bool ended_ = false;
};

struct HttpAnswer {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;
};

/// Reads one answer.
/// @param head  it is one to HEAD: no body comes, whatever its length is said to be
inline HttpAnswer readAnswer(TcpClient& client, bool head = false) {
  HttpAnswer answer;
  std::string text = client.takeUntil("\r\n\r\n");
  answer.status = std::stoi(text.substr(text.find(' ') + 1));
  std::size_t begin = text.find("\r\n") + 2;
  while (begin + 2 < text.size()) {
    const std::size_t end = text.find("\r\n", begin), colon = text.find(':', begin);
    std::string name = text.substr(begin, colon - begin);
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    answer.headers[name] = text.substr(colon + 2, end - colon - 2);
    begin = end + 2;
  }
  if (!head && answer.headers.count("content-length"))
    answer.body = client.take(std::stoul(answer.headers["content-length"]));
  return answer;
}

/// One request on a connection of its own. Host is that of the server unless `headers` has one.
inline HttpAnswer ask(unsigned short port, const std::string& method, const std::string& target,
                      const std::string& headers = "", const std::string& body = "") {
  TcpClient client(port);
  std::string request = method + " " + target + " HTTP/1.1\r\n";
  if (headers.find("Host:") == std::string::npos) request += "Host: 127.0.0.1:" + std::to_string(port) + "\r\n";
  if (!body.empty()) request += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  client.send(request + headers + "\r\n" + body);
  return readAnswer(client, method == "HEAD");
}

/// One WebSocket message or control frame.
struct SocketMessage {
  int kind = 0;  ///< 1 text, 2 binary, 8 close, 9 ping, 10 pong
  std::string data;
  /// Code of a close, 0 where it has none.
  int closeCode() const {
    if (kind != 8 || data.size() < 2) return 0;
    return static_cast<unsigned char>(data[0]) * 256 + static_cast<unsigned char>(data[1]);
  }
};

/// The page's end of a WebSocket.
class SocketClient {
 public:
  /// @param headers  more of the upgrade request; Host and Origin are those of the server's page unless here
  explicit SocketClient(unsigned short port, const std::string& headers = "", const std::string& target = "/ws",
                        int receive_buffer = 0)
      : client_(port, receive_buffer) {
    const std::string host = "127.0.0.1:" + std::to_string(port);
    std::string request = "GET " + target + " HTTP/1.1\r\n";
    if (headers.find("Host:") == std::string::npos) request += "Host: " + host + "\r\n";
    if (headers.find("Origin:") == std::string::npos) request += "Origin: http://" + host + "\r\n";
    client_.send(request + headers +
                 "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                 "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Extensions: permessage-deflate\r\n\r\n");
    answer = readAnswer(client_);
  }

  bool open() const { return answer.status == 101; }

  bool send(const std::string& text) { return sendFrame(1, text); }

  bool sendFrame(int kind, const std::string& data) {
    std::string frame(1, static_cast<char>(0x80 | kind));
    if (data.size() < 126) {
      frame += static_cast<char>(0x80 | data.size());
    } else {
      frame += static_cast<char>(0x80 | (data.size() < 65536 ? 126 : 127));
      for (int shift = data.size() < 65536 ? 8 : 56; shift >= 0; shift -= 8)
        frame += static_cast<char>((data.size() >> shift) & 0xff);
    }
    const char mask[4] = {0x12, 0x34, 0x56, 0x78};
    frame.append(mask, 4);
    for (std::size_t i = 0; i < data.size(); ++i) frame += static_cast<char>(data[i] ^ mask[i % 4]);
    return client_.send(frame);
  }

  void acknowledge(unsigned step) { send("{\"type\":\"ack\",\"frame\":" + std::to_string(step) + "}"); }

  /// The next whole message. Pings are answered and passed over, unless they are wanted.
  SocketMessage read(bool pings = false) {
    SocketMessage message;
    while (true) {
      const std::string head = client_.take(2);
      const int kind = head[0] & 0x0f;
      if (head[0] & 0x70) throw std::runtime_error("a reserved bit is set");
      std::size_t size = static_cast<unsigned char>(head[1]);
      if (size > 127) throw std::runtime_error("the server masks");
      if (size > 125) {
        const std::string bytes = client_.take(size == 126 ? 2 : 8);
        size = 0;
        for (const char byte : bytes) size = size * 256 + static_cast<unsigned char>(byte);
      }
      std::string data = client_.take(size);
      if (kind == 9 && !pings) {
        sendFrame(10, data);
        continue;
      }
      if (kind >= 8) return {kind, data};
      if (kind != 0) message.kind = kind;
      message.data += data;
      if (head[0] & 0x80) return message;
    }
  }

  /// Passes over what comes before the server's close.
  SocketMessage readClose() {
    while (true) {
      SocketMessage message = read();
      if (message.kind == 8) return message;
    }
  }

  TcpClient& connection() { return client_; }

  HttpAnswer answer;  ///< to the upgrade request

 private:
  TcpClient client_;
};

}  // namespace palpate::test
