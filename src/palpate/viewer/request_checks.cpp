#include "palpate/viewer/request_checks.h"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace palpate {
namespace {

constexpr std::size_t kMaxNameCharacters = 100;

/// Address as 16 bytes, IPv4 as ::ffff:a.b.c.d.
using AddressBytes = std::array<unsigned char, 16>;

std::optional<AddressBytes> parsedAddress(const std::string& text) {
  // inet_pton() would take what stands before a zero byte
  if (text.empty() || text.find('\0') != std::string::npos) return std::nullopt;
  AddressBytes bytes{};
  if (inet_pton(AF_INET6, text.c_str(), bytes.data()) == 1) return bytes;
  bytes[10] = bytes[11] = 0xff;
  if (inet_pton(AF_INET, text.c_str(), bytes.data() + 12) == 1) return bytes;
  return std::nullopt;
}

bool isLoopback(const AddressBytes& bytes) {
  constexpr AddressBytes kLoopback6{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1};
  constexpr AddressBytes kLoopback4{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 127};
  return bytes == kLoopback6 || std::equal(kLoopback4.begin(), kLoopback4.begin() + 13, bytes.begin());
}

bool isWildcard(const AddressBytes& bytes) {
  constexpr AddressBytes kAny4{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
  return bytes == AddressBytes{} || bytes == kAny4;
}

bool isDigit(char c) { return c >= '0' && c <= '9'; }
bool isLetterOrDigit(char c) { return isDigit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string lowered(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(), lower);
  return result;
}

int hexDigit(char c) {
  if (isDigit(c)) return c - '0';
  c = lower(c);
  return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

bool isPort(std::string_view text) {
  return !text.empty() && text.size() <= 5 && std::all_of(text.begin(), text.end(), isDigit);
}

std::string_view withoutDefaultPort(std::string_view host) {
  return host.ends_with(":80") ? host.substr(0, host.size() - 3) : host;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

/// The part before the next separator, which is taken off `rest` with it.
std::string_view takePart(std::string_view& rest, char separator) {
  const std::size_t end = std::min(rest.find(separator), rest.size());
  const std::string_view part = rest.substr(0, end);
  rest.remove_prefix(std::min(end + 1, rest.size()));
  return part;
}

/// Takes the next character off UTF-8 text. Nothing where the bytes are none, or an overlong or surrogate one.
std::optional<char32_t> takeCharacter(std::string_view& text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  const std::size_t length = first < 0x80 ? 1 : first < 0xc2 ? 0 : first < 0xe0 ? 2 : first < 0xf0 ? 3 : 4;
  if (length == 0 || first > 0xf4 || text.size() < length) return std::nullopt;
  char32_t character = length == 1 ? first : first & (0xffu >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return std::nullopt;
    character = (character << 6) | (byte(i) & 0x3f);
  }
  if ((length == 3 && character < 0x800) || (length == 4 && character < 0x10000)) return std::nullopt;
  if ((character >= 0xd800 && character < 0xe000) || character > 0x10ffff) return std::nullopt;
  text.remove_prefix(length);
  return character;
}

}  // namespace

bool isAddress(const std::string& text) { return parsedAddress(text).has_value(); }

bool isLoopbackAddress(const std::string& address) {
  const auto bytes = parsedAddress(address);
  return bytes && isLoopback(*bytes);
}

bool isWildcardAddress(const std::string& address) {
  const auto bytes = parsedAddress(address);
  return bytes && isWildcard(*bytes);
}

std::optional<std::string> hostName(std::string_view header) {
  std::string_view name = header, port;
  if (header.starts_with('[')) {
    const std::size_t end = header.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    name = header.substr(1, end - 1);
    port = header.substr(end + 1);
    if (name.find(':') == std::string_view::npos || !isAddress(std::string(name))) return std::nullopt;
  } else {
    const std::size_t colon = std::min(header.find(':'), header.size());
    name = header.substr(0, colon);
    port = header.substr(colon);
    const auto is_name = [](char c) { return isLetterOrDigit(c) || c == '-' || c == '.'; };
    if (name.empty() || name.size() > 253 || !std::all_of(name.begin(), name.end(), is_name)) return std::nullopt;
  }
  if (!port.empty() && (port.front() != ':' || !isPort(port.substr(1)))) return std::nullopt;
  return lowered(name);
}

bool isAllowedHost(std::string_view header, const std::string& listen_address) {
  const auto name = hostName(header);
  if (!name) return false;
  if (*name == "localhost") return true;
  const auto bytes = parsedAddress(*name), listen = parsedAddress(listen_address);
  if (!bytes || !listen) return false;
  return isLoopback(*bytes) || isWildcard(*listen) || *bytes == *listen;
}

bool isOwnOrigin(std::string_view origin, std::string_view host_header) {
  constexpr std::string_view kScheme = "http://";
  const std::string lower_origin = lowered(origin), host = lowered(host_header);
  if (!lower_origin.starts_with(kScheme) || !hostName(host)) return false;
  return withoutDefaultPort(std::string_view(lower_origin).substr(kScheme.size())) == withoutDefaultPort(host);
}

std::string_view targetPath(std::string_view target) { return target.substr(0, target.find('?')); }

std::optional<std::string> percentDecoded(std::string_view text) {
  std::string result;
  result.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      result += text[i] == '+' ? ' ' : text[i];
      continue;
    }
    const int high = i + 2 < text.size() ? hexDigit(text[i + 1]) : -1, low = high < 0 ? -1 : hexDigit(text[i + 2]);
    if (low < 0) return std::nullopt;
    result += static_cast<char>(high * 16 + low);
    i += 2;
  }
  return result;
}

std::optional<std::string> queryValue(std::string_view target, std::string_view name) {
  const std::size_t question = target.find('?');
  if (question == std::string_view::npos) return std::nullopt;
  std::string_view rest = target.substr(question + 1);
  while (!rest.empty()) {
    std::string_view value = takePart(rest, '&');
    if (takePart(value, '=') == name) return percentDecoded(value);
  }
  return std::nullopt;
}

std::optional<std::string_view> cookieValue(std::string_view header, std::string_view name) {
  while (!header.empty()) {
    std::string_view value = trimmed(takePart(header, ';'));
    if (value.find('=') != std::string_view::npos && takePart(value, '=') == name) return value;
  }
  return std::nullopt;
}

bool equalInConstantTime(std::string_view candidate, std::string_view secret) {
  volatile unsigned char difference = candidate.size() != secret.size() || secret.empty();
  for (std::size_t i = 0; i < candidate.size(); ++i) {
    const char other = secret.empty() ? '\0' : secret[i % secret.size()];
    difference = static_cast<unsigned char>(difference | (candidate[i] ^ other));
  }
  return difference == 0;
}

bool isToken(std::string_view text) {
  return !text.empty() && text.size() <= 128 && std::all_of(text.begin(), text.end(), [](char c) {
    return isLetterOrDigit(c) || c == '-' || c == '.' || c == '_' || c == '~';
  });
}

std::optional<std::string> plainFileName(std::string_view name) {
  const std::size_t slash = name.find_last_of("/\\");
  if (slash != std::string_view::npos) name.remove_prefix(slash + 1);
  if (name.empty() || name == "." || name == "..") return std::nullopt;
  std::size_t characters = 0;
  for (std::string_view rest = name; !rest.empty(); ++characters) {
    const auto character = takeCharacter(rest);
    if (!character || *character < 0x20 || (*character >= 0x7f && *character < 0xa0)) return std::nullopt;
  }
  return characters <= kMaxNameCharacters ? std::optional(std::string(name)) : std::nullopt;
}

}  // namespace palpate
