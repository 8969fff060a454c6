#include "serve.h"

#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "palpate/protocol/messages.h"

namespace palpate {

std::string sessionJson(const std::string& mode, const std::string& name, const ServerOptions& options) {
  const nlohmann::ordered_json json{{"mode", mode},
                                    {"protocol", kViewerProtocol},
                                    {"version", options.version},
                                    {"name", name},
                                    {"max_surface_bytes", options.max_surface_bytes}};
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

void announce(const Server& server) {
  fmt::print("open {} in a browser; Ctrl+C ends it\n", server.url());
  std::fflush(stdout);
}

}  // namespace palpate
