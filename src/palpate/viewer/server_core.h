#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "palpate/viewer/server.h"
#include "palpate/viewer/viewer_queue.h"

namespace palpate {

using Executor = boost::asio::io_context::executor_type;
using Socket = boost::asio::basic_stream_socket<boost::asio::ip::tcp, Executor>;

/// A file on disk.
struct DiskFile {
  std::string file, content_type;
};

struct ServerCore;

/// A connection lives as long as an operation on it is pending; the core knows all that live.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  explicit Connection(ServerCore& core);
  virtual ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// The server stops: ends what is going on in good order.
  virtual void finish() = 0;
  /// Closes the socket at once; what is pending ends with an error.
  virtual void cut() = 0;

 protected:
  ServerCore& core_;
};

/// A connection that has become a viewer's.
class Viewer {
 public:
  /// Starts to send what waits, if nothing is being sent.
  virtual void flush() = 0;

  ViewerQueue queue;

 protected:
  ~Viewer() = default;
};

/// What all connections share. Server's thread only, but for `viewer_count`.
struct ServerCore {
  ServerOptions options;
  unsigned short port = 0;
  std::string cookie_name;  ///< with the port in it: cookies do not tell ports apart
  std::map<std::string, StaticFile, std::less<>> files;
  std::map<std::string, DiskFile, std::less<>> disk_files;
  std::string session_json;
  ServerHandlers handlers;

  std::set<Connection*> connections;
  std::map<int, Viewer*> viewers;
  int last_viewer = 0;
  std::atomic<int> viewer_count{0};
  bool receiving_surface = false;  ///< one at a time, which bounds the memory they take
  bool stopping = false;

  std::vector<std::pair<bool, Bytes>> greeting;
  Bytes state;
  std::optional<ViewerFrame> frame;  ///< newest, for newcomers: there may be none for a while

  /// Takes a viewer in.
  /// @return its number
  int join(Viewer& viewer);
  void leave(int viewer);
};

/// Begins to serve a connection. `remote` side is not trusted in anything.
void serveHttp(ServerCore& core, Socket&& socket);

}  // namespace palpate
