#include "palpate/one_d/output.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "palpate/common/error.h"

namespace palpate::one_d {
namespace {

namespace fs = std::filesystem;

class OneDOutput : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("palpate-one-d-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  static std::string read(const fs::path& file) {
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
  }

  static Results shortResults() {
    Config config;
    config.trajectory = {{0.0, 0.2}, {0.1, 0.16}};
    config.visual_dts = {0.01};
    return runExperiment(config);
  }

  fs::path folder_;
};

TEST_F(OneDOutput, CsvReadsBackToTheBit) {
  const Results results = shortResults();
  writeResults(results, folder_);
  std::istringstream csv(read(folder_ / "one_d.csv"));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line, "time,method,visual_dt,latency,xd,xh,xt,force");
  std::vector<const one_d::Run*> runs{&results.reference};
  for (const one_d::Run& run : results.runs) runs.push_back(&run);
  for (const one_d::Run* run : runs) {
    for (std::size_t i = 0; i < results.time.size(); ++i) {
      ASSERT_TRUE(std::getline(csv, line));
      std::vector<std::string> cells;
      std::istringstream row(line);
      for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
      ASSERT_EQ(cells.size(), 8u);
      EXPECT_EQ(cells[1], run->method);
      EXPECT_EQ(std::strtod(cells[0].c_str(), nullptr), results.time[i]);
      EXPECT_EQ(std::strtod(cells[4].c_str(), nullptr), run->trace.device[i]);
      EXPECT_EQ(std::strtod(cells[5].c_str(), nullptr), run->trace.handle[i]);
      EXPECT_EQ(std::strtod(cells[6].c_str(), nullptr), run->trace.tool[i]);
      EXPECT_EQ(std::strtod(cells[7].c_str(), nullptr), run->trace.force[i]);
    }
  }
  EXPECT_FALSE(std::getline(csv, line));
}

TEST_F(OneDOutput, SummaryListsEveryRun) {
  const Results results = shortResults();
  writeResults(results, folder_);
  const auto summary = nlohmann::json::parse(read(folder_ / "summary.json"));
  EXPECT_EQ(summary.at("reference_peak_N"), results.reference_peak);
  ASSERT_EQ(summary.at("runs").size(), 3u);
  const auto& run = summary["runs"][1];
  EXPECT_EQ(run.at("method"), "hsl");
  EXPECT_EQ(run.at("visual_dt"), 0.01);
  EXPECT_EQ(run.at("latency"), 1.0);
  EXPECT_EQ(run.at("rms_N"), results.runs[1].rms);
  EXPECT_EQ(run.at("peak_error_N"), results.runs[1].peak_error);
  EXPECT_TRUE(run.at("drag_N").is_null());  // the motion is over before 0.2 s
}

TEST_F(OneDOutput, TheSameRunGivesTheSameFiles) {
  writeResults(shortResults(), folder_ / "a");
  writeResults(shortResults(), folder_ / "b");
  for (const char* file : {"one_d.csv", "summary.json", "report.html"}) {
    EXPECT_EQ(read(folder_ / "a" / file), read(folder_ / "b" / file)) << file;
    EXPECT_FALSE(read(folder_ / "a" / file).empty()) << file;
  }
}

TEST_F(OneDOutput, ReportHasThePanels) {
  writeResults(shortResults(), folder_);
  const std::string page = read(folder_ / "report.html");
  for (const char* title : {"Positions", "Virtual coupling (VC)", "Handle-space linearization (HSL)"}) {
    EXPECT_NE(page.find(title), std::string::npos) << title;
  }
}

TEST_F(OneDOutput, AFileInTheWayIsAnInputError) {
  fs::create_directories(folder_);
  std::ofstream(folder_ / "taken") << "x";
  EXPECT_THROW(writeResults(shortResults(), folder_ / "taken"), InputError);
  EXPECT_THROW(writeResults(shortResults(), folder_ / "taken" / "deeper"), InputError);
}

}  // namespace
}  // namespace palpate::one_d
