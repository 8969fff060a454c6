#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/haptics/device_state.h"

namespace palpate {

/// What a device is; constant while it is open.
struct DriverInfo {
  std::string name;          ///< for people, e.g. "Haply Inverse3"
  std::string serial;        ///< which of its kind; stays out of reports
  DeviceLimits limits;       ///< at its own rate; peak_torque 0 without torque output
  double rate = 1000.0;      ///< at which limits.stiffness holds [1/s]
  bool has_force = true;     ///< false: an input device
  bool bounded = true;       ///< it has a workspace, whose middle is the origin of its frame; false: rate control
  bool has_velocity = true;  ///< read() gives twist.head<3>(); otherwise it is taken from positions
  bool has_spin = false;     ///< read() gives twist.tail<3>(); otherwise it is taken from orientations
  /// What else is worth knowing (firmware, settings that change forces): for listings and the run's summary. Nothing
  /// that names the person or the machine.
  std::vector<std::pair<std::string, std::string>> facts;
};

/// What a device reports. Its frame: x right, y away from the person, z up.
struct DriverSample {
  Pose pose;                  ///< [m]
  Vec6 twist = Vec6::Zero();  ///< [m/s; rad/s]
  std::uint32_t buttons = 0;  ///< bit k: button k + 1 is pressed
};

/// A device behind its protocol: the one thing to be written for a new kind of device. Opening, which may fail, is the
/// constructor's work: RunError with the exact reason. Everything else (frame, scales, clutch, heat, loss, safety) is
/// done by others.
class DeviceDriver {
 public:
  virtual ~DeviceDriver() = default;
  virtual const DriverInfo& info() const noexcept = 0;

  // From the haptic tick, read() before write(); they neither throw nor allocate, and wait at most for the device's own
  // input and output.

  /// @returns whether the sample is a new state of a device that works; trouble() tells why not
  virtual bool read(DriverSample& sample) noexcept = 0;
  /// @param wrench  to be rendered until the next call, on the device, about its tip, in its frame [N; N m]
  virtual void write(const Vec6& wrench) noexcept = 0;
  /// Zero force, now and until the next write(); also between ticks and when nothing works any more.
  virtual void release() noexcept = 0;

  /// What is wrong; null: nothing. Any thread. The text lives as long as the program.
  virtual const char* trouble() const noexcept { return nullptr; }
  /// It cannot come back: trouble() is the reason.
  virtual bool failed() const noexcept { return false; }
  /// What happened so far that people should know, e.g. "reconnected 2 times"; while no tick runs.
  virtual std::vector<std::string> notes() const { return {}; }

  /// True for a device whose library calls at its own rate: run() then calls `tick` from there until it returns false,
  /// or until the library calls no more, and returns. Otherwise the caller keeps the time.
  virtual bool keepsTime() const noexcept { return false; }
  virtual void run(const std::function<bool()>& /*tick*/) {}
};

}  // namespace palpate
