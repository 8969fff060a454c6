#include "palpate/record/csv_writer.h"

#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "palpate/common/error.h"

namespace palpate {

namespace {

constexpr std::size_t kFlushBytes = 1 << 16;

template <class T>
void append(std::string& out, T value) {
  char digits[32];
  const auto end = std::to_chars(digits, digits + sizeof digits, value).ptr;
  out.append(digits, end);
}

}  // namespace

std::string shortest(double value) {
  std::string out;
  append(out, value);
  return out;
}

CsvWriter::CsvWriter(std::filesystem::path path, const std::vector<std::string>& columns)
    : path_(std::move(path)), columns_(columns.size()) {
  if (columns.empty()) throw std::logic_error("a CSV file needs at least one column");
  file_ = std::fopen(path_.c_str(), "wb");
  if (!file_) throw InputError(path_.string(), "", std::string("cannot be written: ") + std::strerror(errno));
  std::setvbuf(file_, nullptr, _IONBF, 0);  // buffer_ is the buffer
  buffer_.reserve(kFlushBytes + 4096);
  for (const std::string& column : columns) put(std::string_view(column));
  endRow();
}

CsvWriter::~CsvWriter() {
  if (file_) std::fclose(file_);
}

void CsvWriter::put(double value) {
  separate();
  append(buffer_, value);
}

void CsvWriter::put(std::string_view value) {
  separate();
  if (value.find_first_of(",\"\r\n") == std::string_view::npos) {
    buffer_ += value;
    return;
  }
  buffer_ += '"';
  for (const char c : value) buffer_.append(c == '"' ? 2 : 1, c);
  buffer_ += '"';
}

void CsvWriter::put(std::int64_t value) {
  separate();
  append(buffer_, value);
}

void CsvWriter::endRow() {
  if (cells_ != columns_) {
    throw std::logic_error(path_.string() + ": row of " + std::to_string(cells_) + " cells in a table of " +
                           std::to_string(columns_) + " columns");
  }
  cells_ = 0;
  buffer_ += '\n';
  if (buffer_.size() >= kFlushBytes) flush();
}

void CsvWriter::close() {
  if (!file_) return;
  if (cells_ != 0) throw std::logic_error(path_.string() + ": closed in the middle of a row");
  flush();
  const bool failed = std::fclose(std::exchange(file_, nullptr)) != 0;
  if (failed) throw RunError(path_.string() + ": cannot be written: " + std::strerror(errno));
}

void CsvWriter::separate() {
  if (!file_) throw std::logic_error(path_.string() + ": written to after close()");
  if (cells_++ > 0) buffer_ += ',';
}

void CsvWriter::flush() {
  if (!file_) return;
  const std::size_t rows = cells_ == 0 ? buffer_.size() : buffer_.rfind('\n') + 1;
  const std::size_t written = std::fwrite(buffer_.data(), 1, rows, file_);
  const std::string cause = std::strerror(errno);
  keepWholeRows(written);
  if (written != rows) throw RunError(path_.string() + ": cannot be written: " + cause);
}

void CsvWriter::keepWholeRows(std::size_t written) {
  const std::size_t kept = written == 0 ? 0 : buffer_.rfind('\n', written - 1) + 1;
  bytes_ += kept;
  buffer_.erase(0, kept);
  if (kept == written) return;
  std::clearerr(file_);
  if (::ftruncate(::fileno(file_), static_cast<off_t>(bytes_)) == 0) {
    std::fseek(file_, static_cast<long>(bytes_), SEEK_SET);
  }
}

}  // namespace palpate
