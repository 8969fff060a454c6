#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/haptics/device_state.h"

namespace palpate {

struct MotionSample {
  double time = 0.0;  ///< [s]
  DeviceState state;
};

/// Motion of a device. As a file: CSV with a header line, columns in any order:
///   time_s, x_m, y_m, z_m, qw, qx, qy, qz                        required
///   vx_m_s, vy_m_s, vz_m_s, wx_rad_s, wy_rad_s, wz_rad_s         all six or none
///   buttons                                                      optional, bit k is button k + 1
/// World frame; times increase; lines that are empty or begin with # are skipped.
struct MotionRecording {
  std::vector<MotionSample> samples;
  bool has_twist = false;
};

/// Most rows of a recording: half an hour at 1 kHz takes 250 MB.
inline constexpr std::size_t kMaxMotionRows = 2'000'000;

/// @throws InputError naming file and line: file missing, empty or too long; column missing, unknown or double; a value
///   that is not a finite number; time that does not increase; quaternion that is zero or far from a unit one
MotionRecording readMotion(const std::filesystem::path& file);

/// The same from text; `name` stands for the file in errors.
MotionRecording parseMotion(std::string_view text, const std::string& name);

/// Writes with twist, and digits enough that parseMotion() gives back the same bits.
void writeMotion(std::ostream& out, const MotionRecording& recording);

}  // namespace palpate
