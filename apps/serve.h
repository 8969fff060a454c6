#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "palpate/viewer/server.h"

namespace palpate {

/// Where the viewer's server listens; options of view and replay.
struct ServeOptions {
  int port = 7357;
  std::string address;
  std::string token;

  void add(CLI::App& command) {
    command.add_option("--port", port, "Port of the page; 0: any free one")
        ->check(CLI::Range(0, 65535))
        ->capture_default_str();
    command.add_option("--listen", address, "Address to listen on in place of the loopback; needs --token")
        ->type_name("ADDRESS");
    command.add_option("--token", token, "What a browser must know to be served")->type_name("T");
  }

  ServerOptions server() const {
    ServerOptions out;
    if (!address.empty()) out.address = address;
    out.port = static_cast<unsigned short>(port);
    out.token = token;
    out.version = PALPATE_VERSION;
    return out;
  }
};

/// Says on standard output where the page is. From now on Ctrl+C ends the server and not the program, but for a second
/// one.
void announce(Server& server);

}  // namespace palpate
