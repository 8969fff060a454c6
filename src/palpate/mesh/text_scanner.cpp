#include "palpate/mesh/text_scanner.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "palpate/common/error.h"
#include "palpate/common/whole_file.h"

namespace palpate {
namespace {

bool isSpace(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

std::string quoted(std::string_view word) {
  std::string text;
  for (char c : word.substr(0, 40)) text += c >= ' ' && c <= '~' ? c : '?';
  return "'" + text + "'";
}

}  // namespace

void TextScanner::fail(const std::string& cause) const {
  throw InputError(name_, binary_ ? "byte " + std::to_string(next_) : "line " + std::to_string(line_), cause);
}

std::string_view TextScanner::bytes(size_t count) {
  rest_ = {};
  binary_ = true;
  if (count > text_.size() - next_) fail("the file is truncated here");
  const std::string_view result = text_.substr(next_, count);
  next_ += count;
  return result;
}

void TextScanner::skipTo(size_t offset) {
  offset = std::min(offset, text_.size());
  const std::string_view between =
      text_.substr(std::min(offset, next_), std::max(offset, next_) - std::min(offset, next_));
  const auto lines = static_cast<int>(std::count(between.begin(), between.end(), '\n'));
  line_ += offset < next_ ? -lines : lines;
  rest_ = {};
  next_ = offset;
}

void TextScanner::skipPast(const std::string& word) {
  const size_t at = text_.find(word, next_);
  if (at == std::string_view::npos) fail("the file ends where " + word + " should follow");
  rest_ = {};
  next_ = at + word.size();
}

bool TextScanner::nextLine() {
  while (next_ < text_.size()) {
    const size_t end = text_.find('\n', next_);
    rest_ = text_.substr(next_, end == std::string_view::npos ? end : end - next_);
    next_ = end == std::string_view::npos ? text_.size() : end + 1;
    ++line_;
    if (comment_ != 0) rest_ = rest_.substr(0, rest_.find(comment_));
    while (!rest_.empty() && isSpace(rest_.front())) rest_.remove_prefix(1);
    if (!rest_.empty()) return true;
  }
  rest_ = {};
  return false;
}

std::string_view TextScanner::word() {
  while (!rest_.empty() && isSpace(rest_.front())) rest_.remove_prefix(1);
  size_t length = 0;
  while (length < rest_.size() && !isSpace(rest_[length])) ++length;
  const std::string_view result = rest_.substr(0, length);
  rest_.remove_prefix(length);
  return result;
}

std::string_view TextScanner::anyWord(const char* wanted) {
  for (;;) {
    const std::string_view result = word();
    if (!result.empty()) return result;
    if (!nextLine()) fail(std::string("the file ends where ") + wanted + " should follow");
  }
}

double TextScanner::toNumber(std::string_view word, const char* wanted) const {
  if (word.empty()) fail(std::string("the line ends where ") + wanted + " should follow");
  std::string_view digits = word;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  const bool whole = end == digits.data() + digits.size();
  if (whole && error == std::errc::result_out_of_range && digits.find("e-") != std::string_view::npos) return 0;
  if (whole && (error == std::errc::result_out_of_range || (error == std::errc() && !std::isfinite(value))))
    fail(std::string(wanted) + " is not finite: " + quoted(word));
  if (!whole || error != std::errc()) fail(std::string(wanted) + " should be a number, not " + quoted(word));
  return value;
}

long long TextScanner::toInteger(std::string_view word, const char* wanted) const {
  if (word.empty()) fail(std::string("the line ends where ") + wanted + " should follow");
  long long value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (end != word.data() + word.size() || error != std::errc())
    fail(std::string(wanted) + " should be a whole number, not " + quoted(word));
  return value;
}

std::string readFile(const std::string& path, size_t limit) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(path, "", "there is no such file");
  if (!std::filesystem::is_regular_file(status)) throw InputError(path, "", "is not a file");
  const auto size = std::filesystem::file_size(path, error);
  if (error) throw InputError(path, "", "cannot be read: " + error.message());
  if (size == 0) throw InputError(path, "", "is empty");
  if (size > limit) throw InputError(path, "", "is larger than the limit of " + std::to_string(limit >> 20) + " MB");
  std::ifstream in(path, std::ios::binary);
  std::string data(size, '\0');
  if (!in.read(data.data(), static_cast<std::streamsize>(size))) throw InputError(path, "", "cannot be read");
  return data;
}

void writeFile(const std::string& path, const std::string& contents) {
  if (const auto failure = writeThenRename(path, path + ".part", contents))
    throw InputError(path, "", "cannot be written: " + failure->cause);
}

void appendNumber(std::string& out, double value) {
  char buffer[32];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, value);
  if (error == std::errc()) out.append(buffer, end);
}

std::string endingOf(const std::string& path) {
  std::string ending = std::filesystem::path(path).extension().string();
  for (char& c : ending) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return ending;
}

}  // namespace palpate
