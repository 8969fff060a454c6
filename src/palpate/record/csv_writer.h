#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

/// Writes a comma-separated table with a header line. Numbers are the shortest texts that read back as the same double;
/// nothing in it depends on the locale. Buffered; call close() to know that all of it was written.
///
/// Opening throws InputError, a failed write (full disk) RunError naming the file: the file then ends with a whole row,
/// and what is missing waits for the next try. A row with the wrong number of cells is a mistake of the program:
/// std::logic_error.
class CsvWriter {
 public:
  /// @param path     file to write, in general OutputFolder::stage(name)
  /// @param columns  header; units belong into the names
  CsvWriter(std::filesystem::path path, const std::vector<std::string>& columns);
  /// Closes without checking; an unclosed file is one that a failed job left behind.
  ~CsvWriter();
  CsvWriter(const CsvWriter&) = delete;
  CsvWriter& operator=(const CsvWriter&) = delete;

  /// A whole row of numbers.
  void row(std::span<const double> values);

  CsvWriter& cell(double value);
  CsvWriter& cell(std::string_view value);  ///< quoted where commas, quotes or line ends need it
  CsvWriter& cell(const char* value) { return cell(std::string_view(value)); }
  template <std::integral T>
  CsvWriter& cell(T value) {
    return integer(static_cast<std::int64_t>(value));
  }
  void endRow();

  /// Writes the rows so far.
  void flush();
  void close();

 private:
  CsvWriter& integer(std::int64_t value);
  void separate();
  void keepWholeRows(std::size_t written);

  std::filesystem::path path_;
  std::FILE* file_ = nullptr;
  std::string buffer_;
  std::size_t bytes_ = 0;  ///< in the file, in whole rows
  std::size_t columns_ = 0;
  std::size_t cells_ = 0;  ///< in the row under way
};

/// Shortest text that reads back as the same double ("nan", "inf", "-inf" for the others).
std::string shortest(double value);

}  // namespace palpate
