#include "serve.h"

#include <fmt/format.h>

#include <cstdio>

namespace palpate {

void announce(Server& server) {
  server.stopOnSignals();
  fmt::print("open {} in a browser; Ctrl+C ends it\n", server.url());
  std::fflush(stdout);
}

}  // namespace palpate
