#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace palpate {

// What the server asks of a request before it looks at anything else: pure functions of untrusted text. None throws,
// whatever the text.

/// True for a numeric IPv4 or IPv6 address without brackets, port or zone.
bool isAddress(const std::string& text);

/// True for addresses of 127.0.0.0/8 and ::1.
bool isLoopbackAddress(const std::string& address);

/// True for 0.0.0.0 and ::, in any spelling.
bool isWildcardAddress(const std::string& address);

/// Name or address in a Host header, in lower case, without port and brackets.
/// @return nothing where the header is not HOST, HOST:PORT or [ADDRESS]:PORT with a host of letters, digits, '-', '.'
std::optional<std::string> hostName(std::string_view header);

/// Guards against DNS rebinding: true where the Host header names the loopback or the address listened on. A server
/// that listens on every address takes any numeric one: those cannot be rebound.
/// @param header          value of Host
/// @param listen_address  numeric
bool isAllowedHost(std::string_view header, const std::string& listen_address);

/// True where `origin` is the page of this server as the browser reaches it: http:// and what Host says. Both may name
/// another port than the server's own, as behind an SSH tunnel.
bool isOwnOrigin(std::string_view origin, std::string_view host_header);

/// Path of a request target: what stands before '?'.
std::string_view targetPath(std::string_view target);

/// %XX and '+' decoded. Nothing where a % is not followed by two hexadecimal digits.
std::optional<std::string> percentDecoded(std::string_view text);

/// Decoded value of the first parameter of that name. Nothing where it is missing or wrongly encoded.
/// @param target  of the request: "/path?name=value&..."
std::optional<std::string> queryValue(std::string_view target, std::string_view name);

/// Value of the first cookie of that name in a Cookie header.
std::optional<std::string_view> cookieValue(std::string_view header, std::string_view name);

/// Compares in a time that depends on the length of `candidate` only.
bool equalInConstantTime(std::string_view candidate, std::string_view secret);

/// True for what can be a token: 1 to 128 letters, digits and -._~, which URLs and cookies carry as they are.
bool isToken(std::string_view text);

/// What remains of a file name from outside: the part after the last slash or backslash.
/// @return nothing where that is empty, "." or "..", longer than 100 characters, not UTF-8, or has control characters
std::optional<std::string> plainFileName(std::string_view name);

}  // namespace palpate
