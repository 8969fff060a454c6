#pragma once

#include <concepts>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

namespace palpate {

/// A table that is written row by row, cell by cell. A row with the wrong number of cells is a mistake of the program:
/// std::logic_error.
class TableWriter {
 public:
  TableWriter() = default;
  virtual ~TableWriter() = default;
  TableWriter(const TableWriter&) = delete;
  TableWriter& operator=(const TableWriter&) = delete;

  /// A whole row of numbers.
  void row(std::span<const double> values) {
    for (const double value : values) put(value);
    endRow();
  }

  TableWriter& cell(double value) {
    put(value);
    return *this;
  }
  TableWriter& cell(std::string_view value) {
    put(value);
    return *this;
  }
  TableWriter& cell(const char* value) { return cell(std::string_view(value)); }
  template <std::integral T>
  TableWriter& cell(T value) {
    put(static_cast<std::int64_t>(value));
    return *this;
  }
  virtual void endRow() = 0;

  /// So that what has been written is not lost with the program, as far as the format can do it.
  virtual void flush() = 0;
  virtual void close() = 0;

 private:
  virtual void put(double value) = 0;
  virtual void put(std::string_view value) = 0;
  virtual void put(std::int64_t value) = 0;
};

}  // namespace palpate
