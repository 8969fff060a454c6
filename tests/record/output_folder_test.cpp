#include "palpate/record/output_folder.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>

#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/record/json_file.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

class OutputFolders : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("palpate-output-" + std::to_string(::getpid()));
    fs::remove_all(root_);
  }
  void TearDown() override { fs::remove_all(root_); }

  static std::string read(const fs::path& file) {
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
  }
  long entries() const { return std::distance(fs::directory_iterator(root_), fs::directory_iterator()); }

  fs::path root_;
};

TEST_F(OutputFolders, FilesAppearTogetherAtCommit) {
  OutputFolder folder(root_);
  std::ofstream(folder.stage("a.txt")) << "a";
  std::ofstream(folder.stage("b.txt")) << "b";
  EXPECT_FALSE(fs::exists(root_ / "a.txt"));
  folder.commit();
  EXPECT_EQ(read(root_ / "a.txt"), "a");
  EXPECT_EQ(read(root_ / "b.txt"), "b");
  EXPECT_EQ(entries(), 2);
}

TEST_F(OutputFolders, AFailedJobTakesBackTheFoldersItMade) {
  { OutputFolder folder(root_ / "a" / "b"); }
  EXPECT_FALSE(fs::exists(root_));
  fs::create_directories(root_ / "a");
  {
    OutputFolder folder(root_ / "a" / "b");
    std::ofstream(root_ / "a" / "b" / "of somebody else") << "x";
  }
  EXPECT_TRUE(fs::exists(root_ / "a" / "b" / "of somebody else"));
}

// The program ends as the signal would end it; partial files and the folders made for them go first.
TEST_F(OutputFolders, ASignalLeavesNothing) {
  EXPECT_EXIT(
      {
        endCleanlyOnSignals();
        OutputFolder folder(root_ / "a");
        std::ofstream(folder.stage("a.txt")) << "half";
        ::raise(SIGINT);
      },
      testing::KilledBySignal(SIGINT), "");
  EXPECT_FALSE(fs::exists(root_));
}

// A thread can be about to make a file that it has announced when the signal comes to another thread.
TEST_F(OutputFolders, ASignalTakesWhatOtherThreadsMakeMeanwhile) {
  EXPECT_EXIT(
      {
        endCleanlyOnSignals();
        OutputFolder folder(root_ / "a");
        const fs::path announced = folder.stage("a.txt");
        std::thread late([&] {
          while (!interruption::locked.load()) std::this_thread::yield();
          std::this_thread::sleep_for(std::chrono::microseconds(500));
          std::ofstream(announced) << "half";
        });
        ::raise(SIGINT);
        late.join();
      },
      testing::KilledBySignal(SIGINT), "");
  EXPECT_FALSE(fs::exists(root_));
}

TEST_F(OutputFolders, ASignalTakesAWholeFolder) {
  fs::create_directories(root_ / "kept");
  EXPECT_EXIT(
      {
        endCleanlyOnSignals();
        markProvisional(root_ / "work", true);
        fs::create_directories(root_ / "work" / "below" / "further");
        fs::create_directory_symlink(root_ / "kept", root_ / "work" / "link");
        for (int i = 0; i < 200; ++i) std::ofstream(root_ / "work" / "below" / std::to_string(i)) << "x";
        std::ofstream(root_ / "kept" / "file") << "x";
        ::raise(SIGINT);
      },
      testing::KilledBySignal(SIGINT), "");
  EXPECT_FALSE(fs::exists(root_ / "work"));
  EXPECT_TRUE(fs::exists(root_ / "kept" / "file")) << "a link was followed";
}

TEST_F(OutputFolders, ASignalWaitsForACommit) {
  EXPECT_EXIT(
      {
        endCleanlyOnSignals();
        OutputFolder folder(root_);
        std::ofstream(folder.stage("a.txt")) << "whole";
        const UninterruptedScope scope;
        ::raise(SIGINT);
        folder.commit();
      },
      testing::KilledBySignal(SIGINT), "");
  EXPECT_EQ(read(root_ / "a.txt"), "whole");
}

TEST_F(OutputFolders, AFailedJobLeavesNothingAndSparesEarlierFiles) {
  fs::create_directories(root_);
  std::ofstream(root_ / "a.txt") << "earlier";
  {
    OutputFolder folder(root_);
    std::ofstream(folder.stage("a.txt")) << "half";
  }
  EXPECT_EQ(read(root_ / "a.txt"), "earlier");
  EXPECT_EQ(entries(), 1);
}

TEST_F(OutputFolders, CommitMissesNoFile) {
  OutputFolder folder(root_);
  folder.stage("never-written.csv");
  EXPECT_THROW(folder.commit(), RunError);
}

TEST_F(OutputFolders, UnusableFoldersAreInputErrors) {
  fs::create_directories(root_);
  std::ofstream(root_ / "file") << "x";
  for (const fs::path& path : {fs::path(), root_ / "file", root_ / "file" / "below", fs::path("/proc/palpate")}) {
    try {
      OutputFolder folder(path);
      ADD_FAILURE() << path;
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
}

TEST_F(OutputFolders, JsonKeepsItsOrderAndHasNoNan) {
  fs::create_directories(root_);
  nlohmann::ordered_json json;
  json["zeta"] = 0.1;
  json["alpha"] = std::nan("");
  json["name"] = "\xff";
  writeJson(root_ / "summary.json", json);
  EXPECT_EQ(read(root_ / "summary.json"), "{\n  \"zeta\": 0.1,\n  \"alpha\": null,\n  \"name\": \"\xEF\xBF\xBD\"\n}\n");
  EXPECT_EQ(entries(), 1);
}

TEST_F(OutputFolders, JsonIntoAMissingFolderIsAnInputError) {
  EXPECT_THROW(writeJson(root_ / "no" / "summary.json", nlohmann::ordered_json()), InputError);
}

}  // namespace
}  // namespace palpate
