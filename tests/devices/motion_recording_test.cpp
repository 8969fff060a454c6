#include "palpate/devices/motion_recording.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "palpate/common/error.h"

namespace palpate {
namespace {

constexpr char kHeader[] = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n";

std::string errorOf(const std::string& text) {
  try {
    parseMotion(text, "motion.csv");
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(MotionRecording, ReadsColumnsInAnyOrder) {
  const MotionRecording recording = parseMotion(
      "# a comment\r\nqw,qx,qy,qz, buttons "
      ",time_s,x_m,y_m,z_m\r\n1,0,0,0,5,0,1e-3,-2,3\r\n\r\n0.6,0.8,0,0,0,0.001,1,2,3",
      "motion.csv");
  ASSERT_EQ(recording.samples.size(), 2u);
  EXPECT_FALSE(recording.has_twist);
  EXPECT_EQ(recording.samples[0].state.pose.position, Vec3(0.001, -2, 3));
  EXPECT_EQ(recording.samples[0].state.buttons, 5u);
  EXPECT_EQ(recording.samples[1].time, 0.001);
  EXPECT_NEAR(recording.samples[1].state.pose.rotation.x(), 0.8, 1e-15);
}

TEST(MotionRecording, NormalizesRoundedQuaternions) {
  const MotionRecording recording = parseMotion(std::string(kHeader) + "0,0,0,0,0.7071,0.7071,0,0\n", "motion.csv");
  EXPECT_NEAR(recording.samples[0].state.pose.rotation.norm(), 1.0, 1e-15);
}

TEST(MotionRecording, ErrorsNameFileLineAndCause) {
  const std::string header = kHeader;
  EXPECT_EQ(errorOf(""), "motion.csv: is empty; expected a header line with time_s,x_m,y_m,z_m,qw,qx,qy,qz");
  EXPECT_EQ(errorOf(header), "motion.csv: line 1: has no rows");
  EXPECT_EQ(errorOf("time_s,x_m,y_m,z_m,qw,qx,qy\n0,0,0,0,1,0,0"), "motion.csv: line 1: column 'qz' is missing");
  EXPECT_EQ(errorOf("time_s,x_m,y_m,z_m,qw,qx,qy,qz,vx_m_s\n0,0,0,0,1,0,0,0,0"),
            "motion.csv: line 1: column 'vy_m_s' is missing");
  EXPECT_EQ(errorOf("time_s,time_s\n"), "motion.csv: line 1: column 'time_s' is there twice");
  EXPECT_EQ(errorOf("time_s,x_mm\n"), "motion.csv: line 1: unknown column 'x_mm'");
  EXPECT_EQ(errorOf("a\xff"
                    "b,\n"),
            "motion.csv: line 1: unknown column 'a?b'");
  EXPECT_EQ(errorOf(header + "0,0,nan,0,1,0,0,0\n"), "motion.csv: line 2: y_m must be a finite number, not 'nan'");
  EXPECT_EQ(errorOf(header + "0,0,inf,0,1,0,0,0\n"), "motion.csv: line 2: y_m must be a finite number, not 'inf'");
  EXPECT_EQ(errorOf(header + "0,0,1e999,0,1,0,0,0\n"), "motion.csv: line 2: y_m must be a finite number, not '1e999'");
  EXPECT_EQ(errorOf(header + "0,0,1 2,0,1,0,0,0\n"), "motion.csv: line 2: y_m must be a finite number, not '1 2'");
  EXPECT_EQ(errorOf(header + "0,,1,0,1,0,0,0\n"), "motion.csv: line 2: x_m must be a finite number, not ''");
  EXPECT_EQ(errorOf(header + "0,0,0,0,1,0,0\n"), "motion.csv: line 2: has fewer values than the header has columns");
  EXPECT_EQ(errorOf(header + "0,0,0,0,1,0,0,0,0\n"), "motion.csv: line 2: has more values than the header has columns");
  EXPECT_EQ(errorOf(header + "0,0,0,0,0,0,0,0\n"), "motion.csv: line 2: quaternion qw,qx,qy,qz must have norm 1");
  EXPECT_EQ(errorOf(header + "0,0,0,0,1,0,0,0\n0,0,0,0,1,0,0,0\n"),
            "motion.csv: line 3: time_s must increase from row to row");
  EXPECT_EQ(errorOf("buttons," + header + "-1,0,0,0,0,1,0,0,0\n"),
            "motion.csv: line 2: buttons must be a whole number from 0 to 4294967295");
  EXPECT_EQ(errorOf("buttons," + header + "1.5,0,0,0,0,1,0,0,0\n"),
            "motion.csv: line 2: buttons must be a whole number from 0 to 4294967295");
  EXPECT_EQ(errorOf(std::string(100000, 'x')), "motion.csv: line 1: unknown column '" + std::string(40, 'x') + "...'");
  EXPECT_EQ(errorOf(header + "0,0,0,0,1,0,0,0\n"), "accepted");
}

TEST(MotionRecording, StatesItsLimit) {
  std::string text = kHeader;
  text.reserve(60'000'000);
  char row[64];
  for (std::size_t i = 0; i <= kMaxMotionRows; ++i) {
    const int length = std::snprintf(row, sizeof row, "%zu,0,0,0,1,0,0,0\n", i);
    text.append(row, static_cast<std::size_t>(length));
  }
  EXPECT_EQ(errorOf(text), "motion.csv: line 2000002: has more than 2000000 rows; cut it into shorter recordings");
}

TEST(MotionRecording, WrittenBitsComeBack) {
  MotionRecording recording;
  recording.has_twist = true;
  MotionSample sample;
  sample.time = 7 * 0.001;
  sample.state.pose.position = Vec3(1.0 / 3.0, -1e-300, 2e10);
  sample.state.pose.rotation = Quat(0.1, 0.2, 0.3, 0.4).normalized();
  for (int i = 0; i < 6; ++i) sample.state.twist[i] = std::sqrt(i + 2.0);
  sample.state.buttons = 4294967295u;
  recording.samples = {sample};
  std::ostringstream out;
  writeMotion(out, recording);
  const MotionRecording back = parseMotion(out.str(), "motion.csv");
  ASSERT_TRUE(back.has_twist);
  EXPECT_EQ(back.samples[0].time, sample.time);
  EXPECT_EQ(back.samples[0].state.pose.position, sample.state.pose.position);
  EXPECT_EQ(back.samples[0].state.pose.rotation.coeffs(), sample.state.pose.rotation.coeffs());
  EXPECT_EQ(back.samples[0].state.twist, sample.state.twist);
  EXPECT_EQ(back.samples[0].state.buttons, sample.state.buttons);
}

TEST(MotionRecording, ReadsFiles) {
  EXPECT_THROW(readMotion("no/such/motion.csv"), InputError);
  EXPECT_THROW(readMotion("/"), InputError);
  EXPECT_THROW(readMotion("/dev/zero"), InputError);
  const auto file = std::filesystem::temp_directory_path() / ("motion_" + std::to_string(getpid()) + ".csv");
  std::ofstream(file) << kHeader << "0,1,2,3,1,0,0,0\n";
  EXPECT_EQ(readMotion(file).samples.size(), 1u);
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace palpate
