#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/record/table_writer.h"

namespace palpate {

/// Writes a comma-separated table with a header line. Numbers are the shortest texts that read back as the same double;
/// nothing in it depends on the locale. Buffered; call close() to know that all of it was written.
///
/// Opening throws InputError, a failed write (full disk) RunError naming the file: the file then ends with a whole row,
/// and what is missing waits for the next try. A row with the wrong number of cells is a mistake of the program:
/// std::logic_error.
class CsvWriter : public TableWriter {
 public:
  /// @param path     file to write, in general OutputFolder::stage(name)
  /// @param columns  header; units belong into the names
  CsvWriter(std::filesystem::path path, const std::vector<std::string>& columns);
  /// Closes without checking; an unclosed file is one that a failed job left behind.
  ~CsvWriter() override;

  void endRow() override;
  /// Writes the rows so far.
  void flush() override;
  void close() override;

 private:
  void put(double value) override;
  void put(std::string_view value) override;  // quoted where commas, quotes or line ends need it
  void put(std::int64_t value) override;
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
