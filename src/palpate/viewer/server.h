#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/protocol/layout.h"
#include "palpate/viewer/audience.h"

namespace palpate {

struct ServerOptions {
  std::string address = "127.0.0.1";  ///< numeric, IPv4 or IPv6; any but a loopback address demands a token
  unsigned short port = 0;            ///< 0: any free one
  std::string token;                  ///< letters, digits and -._~, at most 128; empty: none is asked for
  std::string version;                ///< of the program, for `welcome`
  int max_viewers = 16;               ///< one more is told so and closed
  std::size_t max_surface_bytes = protocol::kMaxSurfaceBytes;  ///< of POST /surface
  double idle_timeout = 30.0;    ///< connection that sends nothing sensible for so long is closed [s], at least 0.01
  bool stop_on_signals = false;  ///< run() begins with stopOnSignals()
};

/// What the server tells its owner. All are called on the server's thread, one at a time: what they take is time that
/// all viewers wait. They may call every function of the server that any thread may. An exception leaves run().
struct ServerHandlers {
  std::function<void(int viewer)> joined;  ///< after `welcome`, greeting and state are on their way to it
  std::function<void(int viewer)> left;
  /// One text message of a viewer, UTF-8, at most 4 kB; not `ack`, which the server obeys itself.
  std::function<void(int viewer, std::string_view json)> message;
  /// A surface file was sent. `name` is a plain file name: no slashes, no control characters, at most 100 characters.
  /// @param place  it is to be shown and placed first (&place=1)
  /// @return nothing where it is taken (202), else what is wrong with it, for people (400)
  std::function<std::optional<std::string>(const std::string& name, std::string&& body, bool place)> surface;
  /// The server begins to stop: viewers are about to be told, which takes up to a second.
  std::function<void()> stopping;
};

/// A file of the page, from the program itself.
struct StaticFile {
  std::string path;          ///< in the URL: "/app.js"
  std::string content_type;  ///< "text/javascript; charset=utf-8"
  std::string_view content;  ///< outlives the server
};

/// HTTP and WebSocket server of the viewer, for one thread. It knows nothing of what the messages mean but for
/// `welcome` and `ack`, which are its own, and the `lost` field of a batch of samples.
class Server {
 public:
  /// Binds the port; connections wait until run().
  /// @param session_json  what GET /session.json answers
  /// @throws InputError where the address is none or none of this machine, is not a loopback address and there is no
  ///   token, or the port is in use; where the token has other characters than it may
  Server(const ServerOptions& options, std::vector<StaticFile> files, std::string session_json,
         ServerHandlers handlers);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  unsigned short port() const;
  /// What to open in a browser on this machine: "http://127.0.0.1:8080/", with "?token=T" where there is one.
  std::string url() const;

  /// Serves a file on disk, read when it is asked for and sent in pieces. Before run() only.
  /// @throws InputError if it cannot be read
  void addFile(const std::string& file, const std::string& url_path,
               const std::string& content_type = "application/octet-stream");

  /// From now on the first SIGINT, SIGTERM or (unless ignored) SIGHUP does what stop() does; later ones what they did
  /// before. Before run() only.
  void stopOnSignals();

  /// Serves until stop(), on the calling thread; once only. Viewers are told that the server goes.
  void run();

  // The rest may be called from any thread, and never waits for a viewer or for the network.

  /// Ends run() within about a second. Not for signal handlers: see stopOnSignals().
  void stop();

  /// A new generation: messages (binary?, bytes), for all who are there and, after `welcome`, for all who come. Frames
  /// and samples of the generation before it that still wait are dropped, and not counted as lost.
  void setGreeting(std::vector<std::pair<bool, Bytes>> messages);
  /// The newest state, JSON, for all who are there and, after the greeting, for all who come.
  void setState(Bytes json);
  /// JSON for all viewers, or for one. One that lets 4 MiB of them wait is closed.
  void text(Bytes json);
  void textTo(int viewer, Bytes json);
  /// A frame; each viewer gets the newest only, and none while three are on the way to it.
  /// @param step   visual step of it, which the viewer acknowledges
  /// @param full   with the positions of the nodes
  /// @param light  without, for viewers that were sent those of this step already; null: `full` goes to all
  void frame(unsigned step, Bytes full, Bytes light);
  /// A batch of samples, for all viewers, in order. At most 4 MiB of them wait for a viewer; of older ones that are
  /// dropped for it, ticks and `lost` fields are added to the `lost` field (u32 at byte 16) of the next one it gets.
  void samples(Bytes batch, unsigned ticks);

  int viewers() const;
  /// CPU time that run() has taken so far [s].
  double cpuSeconds() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace palpate
