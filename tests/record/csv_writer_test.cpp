#include "palpate/record/csv_writer.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "palpate/common/error.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

class CsvFiles : public testing::Test {
 protected:
  void SetUp() override { file_ = fs::temp_directory_path() / ("palpate-csv-" + std::to_string(::getpid()) + ".csv"); }
  void TearDown() override { fs::remove(file_); }

  std::string content() const {
    std::ostringstream text;
    text << std::ifstream(file_).rdbuf();
    return text.str();
  }

  fs::path file_;
};

TEST_F(CsvFiles, NumbersReadBackToTheBit) {
  std::mt19937_64 random(3);
  std::vector<double> values{0.0, -0.0, 0.1, 1e-5, 1.0 / 3.0, 5e-324, std::numeric_limits<double>::max()};
  while (values.size() < 20000) {
    const double value = std::bit_cast<double>(random());
    if (std::isfinite(value)) values.push_back(value);
  }
  CsvWriter csv(file_, {"value"});
  for (const double value : values) csv.row(std::vector<double>{value});
  csv.close();
  std::ifstream stream(file_);
  std::string line;
  std::getline(stream, line);
  for (const double value : values) {
    ASSERT_TRUE(std::getline(stream, line));
    EXPECT_EQ(std::bit_cast<std::uint64_t>(std::strtod(line.c_str(), nullptr)), std::bit_cast<std::uint64_t>(value));
  }
  EXPECT_FALSE(std::getline(stream, line));
}

TEST_F(CsvFiles, NumbersAreShort) {
  EXPECT_EQ(shortest(0.1), "0.1");
  EXPECT_EQ(shortest(3.0), "3");
  EXPECT_EQ(shortest(0.1 + 0.2), "0.30000000000000004");
}

TEST_F(CsvFiles, CellsOfSeveralKinds) {
  CsvWriter csv(file_, {"a", "b", "c"});
  csv.cell(-3).cell("x").cell(0.5).endRow();
  csv.cell(std::uint64_t{7}).cell("a,b \"c\"").cell(std::nan("")).endRow();
  csv.close();
  EXPECT_EQ(content(), "a,b,c\n-3,x,0.5\n7,\"a,b \"\"c\"\"\",nan\n");
}

TEST_F(CsvFiles, RaggedRowsAreMistakes) {
  CsvWriter csv(file_, {"a", "b"});
  EXPECT_THROW(csv.row(std::vector<double>{1.0}), std::logic_error);
}

TEST_F(CsvFiles, UnwritablePathIsAnInputError) {
  EXPECT_THROW(CsvWriter("/nonexistent/folder/x.csv", {"a"}), InputError);
}

TEST_F(CsvFiles, AFullDiskIsARunError) {
  if (!fs::exists("/dev/full")) GTEST_SKIP();
  CsvWriter csv("/dev/full", {"a"});
  EXPECT_THROW(
      {
        for (int i = 0; i < 100000; ++i) csv.cell(i).endRow();
        csv.close();
      },
      RunError);
}

// A disk that fills up: the file ends with a whole row, and what was left out follows when there is room again.
TEST_F(CsvFiles, AFullDiskKeepsWholeRows) {
  const auto before = ::signal(SIGXFSZ, SIG_IGN);
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit small{1001, limit.rlim_max};
  CsvWriter csv(file_, {"a", "b"});
  const auto write = [&](int from, int to) {
    for (int i = from; i < to; ++i) csv.cell(i).cell("x").endRow();
  };
  setrlimit(RLIMIT_FSIZE, &small);
  write(1000, 1200);
  EXPECT_THROW(csv.flush(), RunError);
  const std::string kept = content();
  setrlimit(RLIMIT_FSIZE, &limit);
  ::signal(SIGXFSZ, before);
  EXPECT_EQ(kept.size(), 998u);  // "a,b" and 142 rows of 7 characters
  EXPECT_EQ(kept.substr(kept.size() - 7), "1141,x\n");
  write(1200, 1300);
  csv.close();
  const std::string all = content();
  EXPECT_EQ(all.size(), 4u + 300u * 7u);
  EXPECT_EQ(all.substr(all.size() - 7), "1299,x\n");
}

}  // namespace
}  // namespace palpate
