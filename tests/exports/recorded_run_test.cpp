#include "palpate/exports/recorded_run.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "palpate/common/error.h"
#include "recording_bytes.h"

namespace palpate {
namespace {

using namespace test;

std::string refusal(const std::string& bytes) {
  try {
    (void)runOf(bytes);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(RecordedRun, BodiesAndTimesAreKnownAtOnce) {
  const RecordedRun run = runOf(recordingBytes());
  ASSERT_EQ(run.bodies().size(), 2U);
  EXPECT_EQ(run.bodies()[0].name, "soft one");
  EXPECT_FALSE(run.bodies()[0].rigid);
  EXPECT_TRUE(run.bodies()[1].rigid);
  EXPECT_EQ(run.bodies()[1].first_node, 4U);
  EXPECT_EQ(run.bodies()[0].rest, unitCorners());
  EXPECT_EQ(run.bodies()[0].lambda, std::vector<float>{kLambda});
  EXPECT_TRUE(run.bodies()[1].mu.empty());
  EXPECT_EQ(run.times(), (std::vector<double>{0.5, 1.0, 2.0}));  // ends of the steps that begin at the frames' times
  EXPECT_TRUE(run.hasMaterials());
  EXPECT_EQ(run.complaint(), "");
  EXPECT_EQ(run.bodyNamed("stone"), 1U);
  try {
    (void)run.bodyNamed("bone");
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("soft one, stone"), std::string::npos) << error.what();
  }
}

TEST(RecordedRun, AFrameHasWhatWasRecorded) {
  RecordedRun run = runOf(recordingBytes());
  const RecordedFrame frame = run.frame(2);
  EXPECT_EQ(frame.time, 2.0);
  EXPECT_EQ(frame.nodes, stretched(1.2F));
  EXPECT_EQ(frame.von_mises, (std::vector<float>{10, 20, 30, 40, 0, 0, 0, 0}));
  EXPECT_EQ(frame.stiffness, (std::vector<float>{2, 1}));
  ASSERT_EQ(frame.forces.size(), 24U);
  EXPECT_EQ(frame.forces[11], 3);  // of node 3, z
  EXPECT_EQ(frame.forces[8], 0);
  ASSERT_EQ(frame.contacts.size(), 1U);
  EXPECT_EQ(frame.contacts[0].force[2], 3);
  EXPECT_EQ(frame.contacts[0].normal[2], 1);
  EXPECT_EQ(frame.contacts[0].state, 2);
  EXPECT_EQ(frame.contacts[0].body, 0);
  EXPECT_EQ(frame.contacts[0].other, -1);
}

TEST(RecordedRun, BetweenFramesAllThatIsContinuousIsMixed) {
  RecordedRun run = runOf(recordingBytes());
  const RecordedFrame frame = run.at(1.25);
  EXPECT_EQ(frame.time, 1.25);
  EXPECT_NEAR(frame.nodes[3], 1.125, 1e-6);
  EXPECT_NEAR(frame.stiffness[0], 1.25, 1e-6);
  EXPECT_EQ(frame.contacts.size(), 1U);
  EXPECT_TRUE(run.at(0.6).contacts.empty());  // the frame before is nearer
  EXPECT_EQ(run.at(0.9).contacts.size(), 1U);
  EXPECT_EQ(run.at(0.0).time, 0.5);
  EXPECT_EQ(run.at(2.0).nodes, stretched(1.2F));
  EXPECT_THROW((void)run.at(2.01), InputError);
  EXPECT_THROW((void)run.at(-0.1), InputError);
  EXPECT_THROW((void)run.at(std::nan("")), InputError);
}

TEST(RecordedRun, WithoutMaterialsAndNames) {
  RecordingParts parts;
  parts.materials = false;
  parts.scene = R"({"type":"scene","bodies":[7,{"name":""}]})";
  RecordedRun run = runOf(recordingBytes(parts));
  EXPECT_FALSE(run.hasMaterials());
  EXPECT_EQ(run.bodies()[0].name, "body1");
  EXPECT_EQ(run.bodies()[1].name, "body2");
  EXPECT_EQ(run.frame(1).stiffness, (std::vector<float>{1, 1}));
}

TEST(RecordedRun, SaysWhatIsDamaged) {
  EXPECT_NE(refusal("").find("no recording"), std::string::npos);
  EXPECT_NE(refusal("PALPATE2" + recordingBytes().substr(8)).find("no recording"), std::string::npos);
  EXPECT_NE(refusal("PALPATE1").find("holds no frames"), std::string::npos);
  RecordingParts parts;
  parts.first_corner = 4;
  EXPECT_NE(refusal(recordingBytes(parts)).find("body soft one"), std::string::npos);
  parts.first_corner = 0xffffffff;
  EXPECT_NE(refusal(recordingBytes(parts)).find("is damaged"), std::string::npos);
  const std::string geometry = record(1, geometryPayload({}));
  EXPECT_NE(refusal("PALPATE1" + geometry + geometry).find("twice"), std::string::npos);
  EXPECT_NE(refusal("PALPATE1" + record(1, framePayload(0, stretched(1), 0))).find("before the geometry"),
            std::string::npos);
  EXPECT_NE(refusal("PALPATE1" + geometry + record(1, framePayload(0, {1, 2, 3}, 0))).find("frame"), std::string::npos);
}

// As a run leaves it whose disk is full, or a file of which bytes were lost: what is whole is read, or it is refused.
TEST(RecordedRun, CutOrChangedAnywhereIsReadOrRefused) {
  const std::string whole = recordingBytes();
  std::size_t read = 0;
  const auto readAll = [&](const std::string& bytes) {
    try {
      RecordedRun run = runOf(bytes);
      for (std::size_t i = 0; i < run.times().size(); ++i) (void)run.frame(i);
      ++read;
      return !run.complaint().empty();
    } catch (const InputError&) {
      return true;
    }
  };
  for (std::size_t length = 0; length < whole.size(); ++length) {
    const bool noted = readAll(whole.substr(0, length));
    // an end between two records cannot be told from the file's, nor one that lacks only the zeros behind a record
    if (length % 8 != 0 && length + 8 < whole.size() &&
        whole.substr(length, 8 - length % 8) != std::string(8 - length % 8, '\0')) {
      EXPECT_TRUE(noted) << length;
    }
  }
  EXPECT_GT(read, 100U);
  for (std::size_t at = 8; at < whole.size(); ++at) {
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ 0x5a);
    (void)readAll(changed);
  }
}

TEST(RecordedRun, OpensAFolderOrTheFile) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::temp_directory_path() / ("palpate-recorded-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "recording.palpate", std::ios::binary) << recordingBytes();
  EXPECT_EQ(RecordedRun::open(folder).times().size(), 3U);
  EXPECT_EQ(RecordedRun::open(folder / "recording.palpate").times().size(), 3U);
  EXPECT_THROW((void)RecordedRun::open(folder / "other.palpate"), InputError);
  EXPECT_THROW((void)RecordedRun::open("/dev/null"), InputError);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace palpate
