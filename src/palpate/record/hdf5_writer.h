#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/record/hdf5_library.h"
#include "palpate/record/table_writer.h"

namespace palpate {

/// Writes a table as an HDF5 file with a data set of one dimension for each column, named as the column: 64-bit numbers
/// or integers, or texts of at most 64 bytes, as the first row has them. Data sets are chunked and compressed; a row
/// costs no memory once its chunk is written. The bytes depend on the rows alone.
///
/// Opening throws InputError, also where there is no libhdf5. A failed write (full disk) is a RunError naming the file:
/// what is missing waits for the next try. flush() does nothing: only what close() has ended can be read.
class Hdf5Writer : public TableWriter {
 public:
  /// @param path     file to write, in general OutputFolder::stage(name)
  /// @param columns  names; units belong into them
  Hdf5Writer(std::filesystem::path path, const std::vector<std::string>& columns);
  /// Closes without checking.
  ~Hdf5Writer() override;

  void endRow() override;
  void flush() override {}
  void close() override;

 private:
  struct Column {
    std::string name;
    std::variant<std::monostate, std::vector<double>, std::vector<std::int64_t>, std::string> waiting;
    Hdf5::Id dataset = -1;
    Hdf5::Size written = 0;  // rows
  };

  void put(double value) override;
  void put(std::string_view value) override;
  void put(std::int64_t value) override;
  template <typename Values>
  Values& next();
  void writeWaiting();
  void write(Column& column, const void* data, Hdf5::Id type, Hdf5::Size rows);
  void create(Column& column, Hdf5::Id type);
  [[noreturn]] void fail() const;

  std::filesystem::path path_;
  const Hdf5& hdf5_;
  Hdf5::Id file_ = -1;
  Hdf5::Id text_ = -1;  // type of texts
  std::vector<Column> columns_;
  Hdf5::Size rows_ = 0;     // in all
  Hdf5::Size waiting_ = 0;  // of them not in the file
  std::size_t cells_ = 0;   // in the row under way
};

}  // namespace palpate
