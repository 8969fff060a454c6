#include "palpate/record/hdf5_writer.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cmath>
#include <csignal>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "palpate/common/dynamic_library.h"
#include "palpate/common/error.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

class Hdf5Table : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      Hdf5::library();
    } catch (const InputError& e) {
      GTEST_SKIP() << e.what();
    }
  }
  void TearDown() override { fs::remove(path_); }

  /// A column of numbers, by the library's own reader.
  std::vector<double> read(const char* column, std::size_t rows) const {
    const DynamicLibrary library({"libhdf5_serial.so.103", "libhdf5.so.103", "libhdf5_serial.so", "libhdf5.so"});
    Hdf5::Id (*open)(const char*, unsigned, Hdf5::Id) = nullptr;
    Hdf5::Id (*dataset)(Hdf5::Id, const char*, Hdf5::Id) = nullptr;
    int (*read)(Hdf5::Id, Hdf5::Id, Hdf5::Id, Hdf5::Id, Hdf5::Id, void*) = nullptr;
    library.find(open, "H5Fopen");
    library.find(dataset, "H5Dopen2");
    library.find(read, "H5Dread");
    const Hdf5& h5 = Hdf5::library();
    std::vector<double> out(rows);
    const Hdf5::Id file = open(path_.c_str(), 0, 0), data = dataset(file, column, 0);
    EXPECT_GE(read(data, h5.double_type, 0, 0, 0, out.data()), 0);
    h5.dataset_close(data);
    h5.file_close(file);
    return out;
  }

  fs::path path_ = fs::temp_directory_path() / ("palpate-table-" + std::to_string(::getpid()) + ".h5");
};

/// Not to be compressed.
double noise(int row) { return std::sin(1e5 * row * row); }

TEST_F(Hdf5Table, WhatAFullDiskRefusedWaitsForTheNextTry) {
  constexpr int kRows = 20000;
  rlimit usual{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &usual), 0);
  const auto before = std::signal(SIGXFSZ, SIG_IGN);
  Hdf5Writer table(path_, {"first", "row", "second"});
  int failures = 0;
  for (int row = 0; row < kRows; ++row) {
    const rlimit small{100000, usual.rlim_max};
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, row < kRows / 2 ? &small : &usual), 0);
    table.cell(noise(row)).cell(row).cell(noise(row + 1));
    try {
      table.endRow();
    } catch (const RunError& e) {
      ++failures;
      EXPECT_NE(std::string(e.what()).find(path_.string()), std::string::npos);
    }
  }
  EXPECT_GT(failures, 0);
  table.close();
  std::signal(SIGXFSZ, before);
  const std::vector<double> first = read("first", kRows), numbers = read("row", kRows), second = read("second", kRows);
  for (int row = 0; row < kRows; ++row) {
    ASSERT_EQ(first[row], noise(row)) << row;
    ASSERT_EQ(numbers[row], row);
    ASSERT_EQ(second[row], noise(row + 1)) << row;
  }
}

TEST_F(Hdf5Table, MistakesOfTheProgram) {
  Hdf5Writer table(path_, {"a", "b"});
  table.cell(1.0);
  EXPECT_THROW(table.endRow(), std::logic_error);
  table.cell(std::string(64, 'x')).endRow();
  EXPECT_THROW(table.cell(1), std::logic_error);  // an integer in a column of numbers
  EXPECT_THROW(table.cell(std::string(65, 'x')), std::logic_error);
}

TEST_F(Hdf5Table, CannotBeWrittenWhereThereIsNoFolder) {
  EXPECT_THROW(Hdf5Writer("/no/such/folder/table.h5", {"a"}), InputError);
}

}  // namespace
}  // namespace palpate
