#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace palpate {

/// Bytes of a base64 text, as many at a time as wanted. Spaces and line ends count for nothing; padding may stand
/// within the text, where several were put one behind the other.
class Base64Reader {
 public:
  explicit Base64Reader(std::string_view text) : text_(text) {}

  /// Appends the next bytes; false if there are fewer, or what follows is no base64.
  bool take(std::size_t count, std::string& out) {
    while (waiting_.size() < count) {
      if (!group()) return false;
    }
    out.append(waiting_, 0, count);
    waiting_.erase(0, count);
    return true;
  }
  /// Appends all bytes that are left; false if some of the text is no base64.
  bool takeAll(std::string& out) {
    while (group()) {
    }
    out += waiting_;
    waiting_.clear();
    return text_.find_first_not_of(" \t\r\n") == std::string_view::npos;
  }

 private:
  static int valueOf(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
  }

  // Four characters, which are three bytes or, padded, fewer.
  bool group() {
    std::uint32_t bits = 0;
    int characters = 0, padding = 0;
    std::size_t used = 0;
    for (; used < text_.size() && characters < 4; ++used) {
      const char c = text_[used];
      if (c == ' ' || c == '\t' || c == '\r' || c == '\n') continue;
      const int value = valueOf(c);
      if (c == '=' ? characters < 2 : value < 0 || padding > 0) return false;
      if (c == '=') ++padding;
      bits = bits << 6U | static_cast<std::uint32_t>(c == '=' ? 0 : value);
      ++characters;
    }
    if (characters != 4) return false;
    text_.remove_prefix(used);
    for (int k = 0; k < 3 - padding; ++k)
      waiting_ += static_cast<char>(bits >> (16U - 8U * static_cast<unsigned>(k)) & 0xFFU);
    return true;
  }

  std::string_view text_;
  std::string waiting_;
};

}  // namespace palpate
