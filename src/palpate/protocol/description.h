#pragma once

#include <string>

namespace palpate {

/// What protocol/layout.h and protocol/commands.h fix, as the JSON file web/src/protocol.json that the page is built
/// with. A test compares the two.
std::string protocolDescription();

}  // namespace palpate
