// Any bytes in what a request to the viewer's server carries: Host, Origin, query, cookie, file name, acknowledgment.
// The first byte chooses which; what is let through has the form that the server relies on.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "palpate/protocol/server_messages.h"
#include "palpate/viewer/request_checks.h"

namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

bool isGraphic(std::string_view text) {
  for (const char c : text)
    if (c <= 0x20 || c >= 0x7f) return false;
  return true;
}

void checkHost(std::string_view text) {
  for (const char* listen : {"127.0.0.1", "192.168.1.7", "0.0.0.0", "::"}) {
    if (!palpate::isAllowedHost(text, listen)) continue;
    require(isGraphic(text) && palpate::hostName(text).has_value());
    require(*palpate::hostName(text) == "localhost" || palpate::isAddress(*palpate::hostName(text)));
  }
  if (palpate::hostName(text)) require(palpate::isOwnOrigin("http://" + std::string(text), text));
}

void checkOrigin(std::string_view text) {
  const std::size_t space = text.find(' ');
  if (space == std::string_view::npos) return;
  if (palpate::isOwnOrigin(text.substr(0, space), text.substr(space + 1)))
    require(isGraphic(text.substr(0, space)) && palpate::hostName(text.substr(space + 1)).has_value());
}

void checkName(std::string_view text) {
  const auto name = palpate::plainFileName(text);
  if (!name) return;
  require(!name->empty() && name->size() <= 400 && *name != "." && *name != "..");
  for (const char c : *name) require(c != '/' && c != '\\' && c != 0x7f && (c < 0 || c >= 0x20));
  require(!nlohmann::json(*name).dump().empty());  // throws for what is not UTF-8
  require(palpate::plainFileName(*name) == name);
}

void checkQuery(std::string_view text) {
  require(palpate::targetPath(text).find('?') == std::string_view::npos);
  const auto value = palpate::queryValue(text, "name");
  if (!value) return;
  require(value->size() < text.size());
  checkName(*value);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0] % 6) {
    case 0:
      checkHost(text);
      break;
    case 1:
      checkOrigin(text);
      break;
    case 2:
      checkQuery(text);
      break;
    case 3:
      if (const auto value = palpate::cookieValue(text, "palpate-80"))
        require(value->find(';') == std::string_view::npos);
      break;
    case 4:
      if (palpate::isToken(text)) require(palpate::equalInConstantTime(text, text) && isGraphic(text));
      require(!palpate::equalInConstantTime(text, std::string(text) + "x"));
      break;
    default:
      if (palpate::acknowledgedStep(text)) require(nlohmann::json::accept(text));
  }
  return 0;
}
