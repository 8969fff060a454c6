#include <boost/asio/buffer.hpp>
#include <boost/beast/core/error.hpp>
#include <boost/beast/core/file.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "palpate/viewer/request_checks.h"
#include "palpate/viewer/viewer_connection.h"

namespace palpate {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using Error = boost::system::error_code;
using Clock = std::chrono::steady_clock;

constexpr std::uint32_t kMaxHeader = 32 << 10;  // a browser sends the cookies of all servers on this host
constexpr std::size_t kReadBuffer = 64 << 10, kPiece = 64 << 10;
constexpr auto kMaxUploadTime = std::chrono::minutes(5);
constexpr auto kMaxLingering = std::chrono::seconds(5);
constexpr std::string_view kJson = "application/json; charset=utf-8";
constexpr std::string_view kText = "text/plain; charset=utf-8";
constexpr std::string_view kSurfacePath = "/surface", kSocketPath = "/ws", kSessionPath = "/session.json";

std::string_view viewOf(beast::string_view text) { return {text.data(), text.size()}; }
beast::string_view viewOf(std::string_view text) { return {text.data(), text.size()}; }

class HttpConnection final : public Connection {
 public:
  HttpConnection(ServerCore& core, Socket&& socket)
      : Connection(core),
        stream_(std::move(socket)),
        patience_(std::chrono::milliseconds(static_cast<long>(1e3 * core.options.idle_timeout))) {}
  ~HttpConnection() override { endUpload(); }

  void start() { readHeader(); }

  void finish() override {
    if (waiting_) cut();  // otherwise an answer is on its way
  }

  void cut() override { stream_.close(); }

 private:
  std::shared_ptr<HttpConnection> shared() { return std::static_pointer_cast<HttpConnection>(shared_from_this()); }

  const http::request<http::empty_body>& request() const { return parser_->get(); }

  // --- reading a request

  void readHeader() {
    parser_.emplace();
    parser_->header_limit(kMaxHeader);
    parser_->body_limit(std::numeric_limits<std::uint64_t>::max());  // bounded where a body is read at all
    waiting_ = true;
    stream_.expires_after(patience_);
    http::async_read_header(stream_, buffer_, *parser_, [self = shared()](Error error, std::size_t) {
      self->waiting_ = false;
      self->onHeader(error);
    });
  }

  void onHeader(Error error) {
    static const auto& http_errors = http::make_error_code(http::error::end_of_stream).category();
    keep_ = head_ = false;
    if (error == http::error::end_of_stream || (error && error.category() != http_errors)) return cut();
    if (error == http::error::header_limit)
      return answerText(http::status::request_header_fields_too_large, "the header is too long");
    if (error) return answerText(http::status::bad_request, "this is not HTTP");
    const bool has_body = parser_->chunked() || parser_->content_length().value_or(0) > 0;
    keep_ = request().keep_alive() && !has_body;  // a body that nobody reads is not to be taken for a request
    head_ = request().method() == http::verb::head;
    if (allowed()) route();
  }

  /// The only header of that name; empty where there is none, or where there are several.
  std::string_view header(http::field name) const {
    return request().count(name) == 1 ? viewOf(request()[name]) : std::string_view();
  }

  std::string_view target() const { return viewOf(request().target()); }

  // --- who may ask

  /// Checks who asks, and answers where it is refused.
  bool allowed() {
    if (!target().starts_with('/')) {
      answerText(http::status::bad_request, "the target is not a path");
    } else if (!isAllowedHost(header(http::field::host), core_.options.address)) {
      answerText(http::status::forbidden,
                 "this host name is not served: open the address that palpate printed, with the numbers in it");
    } else if (changesSomething() && !fromOwnPage()) {
      answerText(http::status::forbidden, "another page may not do this");
    } else if (!hasToken()) {
      answerText(http::status::forbidden, "open the address that palpate printed, with its token");
    } else {
      return true;
    }
    return false;
  }

  bool changesSomething() const {
    return targetPath(target()) == kSocketPath ||
           (request().method() != http::verb::get && request().method() != http::verb::head);
  }

  /// A browser names the page that asks. Programs do not, and they cannot be made to ask by a foreign page.
  bool fromOwnPage() const {
    if (request().count(http::field::origin) > 0)
      return isOwnOrigin(header(http::field::origin), header(http::field::host));
    return request().count(http::field::referer) == 0 && request().count("Sec-Fetch-Site") == 0 &&
           !viewOf(request()[http::field::user_agent]).starts_with("Mozilla/");
  }

  bool hasToken() const {
    const std::string& token = core_.options.token;
    if (token.empty()) return true;
    for (const auto& field : request()) {
      if (field.name() != http::field::cookie) continue;
      const auto cookie = cookieValue(viewOf(field.value()), core_.cookie_name);
      if (cookie && equalInConstantTime(*cookie, token)) return true;
    }
    const auto given = queryValue(target(), "token");
    return given && equalInConstantTime(*given, token);
  }

  // --- what is asked

  void route() {
    const std::string_view path = targetPath(target());
    const bool reads = head_ || request().method() == http::verb::get;
    const auto file = core_.files.find(path);
    const auto disk_file = core_.disk_files.find(path);
    if (path == kSurfacePath && core_.handlers.surface) {
      if (request().method() == http::verb::post) return receiveSurface();
      return wrongMethod("POST");
    }
    if (path == kSocketPath) {
      if (request().method() != http::verb::get) return wrongMethod("GET");
      return upgrade();
    }
    if (file == core_.files.end() && disk_file == core_.disk_files.end() && path != kSessionPath)
      return answerText(http::status::not_found, "there is nothing here");
    if (!reads) return wrongMethod("GET, HEAD");
    if (path == kSessionPath) return answer(http::status::ok, kJson, core_.session_json);
    if (file != core_.files.end()) return answer(http::status::ok, file->second.content_type, file->second.content);
    sendFile(disk_file->second);
  }

  void wrongMethod(std::string_view allowed) {
    auto headers = answerHeaders(http::status::method_not_allowed, kText);
    headers.set(http::field::allow, viewOf(allowed));
    send(std::move(headers), "not with this method");
  }

  void upgrade() {
    // bytes that come before the answer do not belong to a WebSocket yet
    if (!beast::websocket::is_upgrade(request()) || buffer_.size() > 0 || core_.stopping) {
      auto headers = answerHeaders(http::status::upgrade_required, kText);
      headers.set(http::field::upgrade, "websocket");
      keep_ = false;
      return send(std::move(headers), "this is for WebSockets");
    }
    serveViewer(core_, std::move(stream_), parser_->release());
  }

  // --- a surface file

  void receiveSurface() {
    if (parser_->content_length().value_or(0) > core_.options.max_surface_bytes) return surfaceTooLarge();
    const auto given = queryValue(target(), "name");
    const auto name = given ? plainFileName(*given) : std::nullopt;
    if (!name) {
      return answerError(http::status::bad_request,
                         "the file's name (?name=) is missing, longer than 100 characters or has control characters");
    }
    const auto place = queryValue(target(), "place");
    if (place && *place != "0" && *place != "1") return answerError(http::status::bad_request, "place must be 0 or 1");
    if (core_.receiving_surface)
      return answerError(http::status::service_unavailable, "another surface is being sent; try again");
    core_.receiving_surface = owns_upload_ = true;
    surface_name_ = *name;
    place_surface_ = place == "1";
    keep_after_upload_ = request().keep_alive();
    const bool expects = beast::iequals(request()[http::field::expect], "100-continue");
    upload_end_ = Clock::now() + kMaxUploadTime;
    upload_.emplace(std::move(*parser_));
    upload_->body_limit(core_.options.max_surface_bytes);
    if (!expects) return readSurface();
    piece_ = "HTTP/1.1 100 Continue\r\n\r\n";
    content_ = {};
    writePiece(&HttpConnection::readSurface);
  }

  void readSurface() {
    if (upload_->is_done()) return surfaceReceived();
    if (Clock::now() > upload_end_ || core_.stopping) return cut();
    stream_.expires_after(patience_);
    http::async_read_some(stream_, buffer_, *upload_, [self = shared()](Error error, std::size_t) {
      if (error == http::error::body_limit) return self->surfaceTooLarge();
      if (error) return self->cut();
      self->readSurface();
    });
  }

  void surfaceReceived() {
    keep_ = keep_after_upload_;
    std::string body = std::move(upload_->get().body());
    endUpload();
    if (body.empty()) return answerError(http::status::bad_request, "the file is empty");
    if (const auto error = core_.handlers.surface(surface_name_, std::move(body), place_surface_))
      return answerError(http::status::bad_request, *error);
    answerJson(http::status::accepted, {{"name", surface_name_}});
  }

  void surfaceTooLarge() {
    endUpload();
    keep_ = false;
    answerError(http::status::payload_too_large,
                "the file is larger than " + std::to_string(core_.options.max_surface_bytes) + " bytes");
  }

  void endUpload() {
    upload_.reset();
    if (std::exchange(owns_upload_, false)) core_.receiving_surface = false;
  }

  // --- answers

  http::fields commonHeaders() const {
    http::fields headers;
    setSafetyHeaders(headers);
    return headers;
  }

  http::response_header<> answerHeaders(http::status status, std::string_view content_type) {
    http::response_header<> headers(commonHeaders());
    headers.result(status);
    headers.version(11);
    headers.set(http::field::content_type, viewOf(content_type));
    // from the second answer on the cookie is there: it is set by the page only, whose address has the token
    if (!core_.options.token.empty() && status == http::status::ok && content_type.starts_with("text/html")) {
      headers.set(http::field::set_cookie,
                  core_.cookie_name + "=" + core_.options.token + "; Path=/; HttpOnly; SameSite=Strict");
    }
    return headers;
  }

  void answer(http::status status, std::string_view content_type, std::string_view content) {
    send(answerHeaders(status, content_type), content);
  }

  void answerText(http::status status, std::string_view line) {
    text_ = std::string(line) + "\n";
    answer(status, kText, text_);
  }

  void answerJson(http::status status, const nlohmann::json& json) {
    text_ = json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    answer(status, kJson, text_);
  }

  void answerError(http::status status, const std::string& error) { answerJson(status, {{"error", error}}); }

  /// @param content  outlives the answer
  void send(http::response_header<>&& headers, std::string_view content) {
    content_ = content;
    write(std::move(headers), content.size());
  }

  void sendFile(const DiskFile& file) {
    Error error;
    file_.open(file.file.c_str(), beast::file_mode::scan, error);
    const std::uint64_t size = error ? 0 : file_.size(error);
    if (error) return answerText(http::status::not_found, "the file is gone");
    content_ = {};
    write(answerHeaders(http::status::ok, file.content_type), size);
  }

  /// Sends the headers, and after them what is asked for of `content_` or `file_`. Beast's own way to write a response
  /// takes a quarter of the time that this room compiles in.
  void write(http::response_header<>&& headers, std::uint64_t size) {
    if (core_.stopping) keep_ = false;
    http::response<http::empty_body> response(std::move(headers));
    response.content_length(size);
    response.keep_alive(keep_);
    std::ostringstream text;
    text << response.base();
    piece_ = text.str();
    file_left_ = file_.is_open() && !head_ ? size : 0;
    if (head_) content_ = {};
    fillPiece();
    writePiece(&HttpConnection::onWritten);
  }

  /// Adds what follows to the piece, up to `kPiece` bytes.
  void fillPiece() {
    const std::size_t room = kPiece - std::min(kPiece, piece_.size());
    const auto next = content_.substr(0, room);
    piece_ += next;
    content_.remove_prefix(next.size());
    if (file_left_ == 0) return;
    const std::size_t before = piece_.size();
    const std::size_t wanted = std::min<std::uint64_t>(file_left_, room);
    piece_.resize(before + wanted);
    Error error;
    const std::size_t read = file_.read(&piece_[before], wanted, error);
    piece_.resize(before + read);
    file_left_ -= read;
    if (read < wanted) cut();  // the file has become shorter
  }

  /// Sends the piece and what follows. Each piece has its own time: a large file over a slow line is not an idle
  /// connection.
  void writePiece(void (HttpConnection::*then)(), std::size_t sent = 0) {
    if (sent == piece_.size()) {
      piece_.clear();
      fillPiece();
      sent = 0;
    }
    if (piece_.empty()) {
      Error ignored;
      file_.close(ignored);
      return (this->*then)();
    }
    stream_.expires_after(patience_);
    stream_.async_write_some(asio::buffer(piece_.data() + sent, piece_.size() - sent),
                             [self = shared(), then, sent](Error error, std::size_t more) {
                               if (error) return self->cut();
                               self->writePiece(then, sent + more);
                             });
  }

  void onWritten() {
    if (keep_ && !core_.stopping) return readHeader();
    Error ignored;
    stream_.socket().shutdown(asio::socket_base::shutdown_send, ignored);
    waiting_ = true;
    stream_.expires_after(kMaxLingering);
    linger();
  }

  /// Closing with bytes unread would reset the connection, and the other side might never read the answer.
  void linger() {
    buffer_.clear();
    stream_.async_read_some(buffer_.prepare(kReadBuffer), [self = shared()](Error error, std::size_t) {
      if (error) return self->cut();
      self->linger();
    });
  }

  Stream stream_;
  Clock::duration patience_;  ///< for each read and each write
  beast::flat_buffer buffer_{kReadBuffer};
  std::optional<http::request_parser<http::empty_body>> parser_;
  bool waiting_ = false;  ///< for a request, or for the end of the connection
  bool keep_ = false;     ///< the connection is for further requests
  bool head_ = false;     ///< headers only are asked for
  std::string text_;      ///< content that was made for this answer

  std::string piece_;         ///< what is being sent
  std::string_view content_;  ///< what follows it
  beast::file file_;          ///< or what of this file
  std::uint64_t file_left_ = 0;

  std::optional<http::request_parser<http::string_body>> upload_;
  std::string surface_name_;
  bool place_surface_ = false;
  Clock::time_point upload_end_;
  bool owns_upload_ = false, keep_after_upload_ = false;
};

}  // namespace

void setSafetyHeaders(http::fields& headers) {
  headers.set(http::field::server, "palpate");
  headers.set("X-Content-Type-Options", "nosniff");
  headers.set(
      "Content-Security-Policy",
      "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
      "base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
  headers.set("Cross-Origin-Resource-Policy", "same-origin");
  headers.set("X-Frame-Options", "DENY");
  headers.set("Referrer-Policy", "same-origin");  // the first page's address has the token in it
  headers.set(http::field::cache_control, "no-store");
}

void serveHttp(ServerCore& core, Socket&& socket) {
  std::make_shared<HttpConnection>(core, std::move(socket))->start();
}

}  // namespace palpate
