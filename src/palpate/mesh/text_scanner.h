#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace palpate {

/// Words and numbers of a text in memory, with the line for messages. Numbers do not depend on the locale.
class TextScanner {
 public:
  TextScanner(std::string_view text, const std::string& name) : text_(text), name_(name) {}

  /// Goes to the next line that has a word; false at the end.
  bool nextLine();
  /// Next word of the line; empty at its end.
  std::string_view word();
  /// Next word, from following lines if this one has ended. Throws InputError at the end of the text.
  std::string_view anyWord(const char* wanted);

  double number(const char* wanted) { return toNumber(word(), wanted); }
  double anyNumber(const char* wanted) { return toNumber(anyWord(wanted), wanted); }
  long long integer(const char* wanted) { return toInteger(word(), wanted); }
  long long anyInteger(const char* wanted) { return toInteger(anyWord(wanted), wanted); }

  /// Throw InputError if the word is no number, or not finite.
  double toNumber(std::string_view word, const char* wanted) const;
  long long toInteger(std::string_view word, const char* wanted) const;

  /// Everything from `comment` to the end of a line is skipped.
  void setComment(char comment) { comment_ = comment; }
  void skipRestOfLine() { rest_ = {}; }
  /// The next bytes, from the beginning of the next line on; what is left of this one is dropped, and messages name
  /// bytes instead of lines from here on. Throws InputError if the text has not as many left.
  std::string_view bytes(size_t count);
  /// Goes on with the line that begins at an offset() of before or behind.
  void skipTo(size_t offset);
  /// To behind the next `word`, which ends a part that does not matter. Throws InputError if there is none.
  void skipPast(const std::string& word);
  size_t offset() const { return next_; }  ///< of the next line
  int line() const { return line_; }
  [[noreturn]] void fail(const std::string& cause) const;

 private:
  std::string_view text_;
  std::string name_;
  std::string_view rest_;
  size_t next_ = 0;
  int line_ = 0;
  bool binary_ = false;
  char comment_ = '#';
};

/// Contents of a file; throws InputError if it is missing, no file, empty, or larger than `limit` bytes.
std::string readFile(const std::string& path, size_t limit = size_t{1} << 30);
/// Writes a file under a temporary name in the same folder and renames it. Throws InputError.
void writeFile(const std::string& path, const std::string& contents);
/// Appends the shortest text that reads back as the same number.
void appendNumber(std::string& out, double value);
/// Lower-case ending of a file name with its dot, "" if none.
std::string endingOf(const std::string& path);

}  // namespace palpate
