#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/devices/device_memory.h"
#include "palpate/haptics/device_state.h"

namespace palpate {

/// What a run says of a device on a desk. Empty name: there was none.
struct DeviceReport {
  std::string name;
  std::vector<std::pair<std::string, std::string>> facts;  ///< what the device says of itself
  std::vector<std::string> notes;                          ///< what happened, for people
  double heat = 0.0;                                       ///< largest, in shares of what the motors bear for ever
  double hot_s = 0.0;                                      ///< time in which heat lowered the limit of the force [s]
  double lost_s = 0.0;                                     ///< time without the device [s]
  int losses = 0;                                          ///< times that it was lost
  int jumps = 0;                                           ///< of its position
  int clutches = 0;                                        ///< times that the clutch was pressed
  double indexed_m = 0.0;                                  ///< way that the border has moved the handle [m]
};

/// A haptic device, or something that stands for one. sample() and apply() are called from the haptic tick: they
/// neither block, allocate nor throw. Opening, which may fail, is the constructor's work.
class Device {
 public:
  virtual ~Device() = default;
  virtual const char* name() const noexcept = 0;
  virtual DeviceLimits limits() const noexcept = 0;
  /// Before the first tick: the run begins at rest, and the hand already carries `wrench` [N; N m], world frame, about
  /// the handle's origin. Nothing to do for a device that a person holds, or that feels nothing.
  virtual void begin(const Vec6& /*wrench*/) noexcept {}
  /// State at time t [s] since the start of the run; t does not decrease, but by restore().
  virtual DeviceState sample(double t) noexcept = 0;
  /// Commands the wrench on the device [N; N m], world frame, about the handle's origin, held for the tick [t, t + dt).
  virtual void apply(const Vec6& wrench, double t, double dt) noexcept = 0;

  // What only a device on a desk has.

  /// True for one whose library calls at its own rate: run() then calls `tick` from there until it returns false, or
  /// until the library calls no more, and returns. Otherwise the caller keeps the time.
  virtual bool keepsTime() const noexcept { return false; }
  virtual void run(const std::function<bool()>& /*tick*/) {}
  /// A person holds it: the force is to leave whenever ticks end, and time cannot stand still.
  virtual bool isReal() const noexcept { return false; }
  /// Why it does not work and will not again; null: it does, or it may yet. Any thread.
  virtual const char* failure() const noexcept { return nullptr; }
  /// What a run's summary says of it; while no tick runs.
  virtual DeviceReport report() const { return {}; }

  /// What the device must remember between two ticks. Given back to a device that was built alike, it makes the run go
  /// on to the bit. Nothing for a device that depends on time alone, and for real ones, which cannot go back.
  virtual DeviceMemory save() const { return {}; }
  /// Between two ticks. @throws InputError for what is not of this kind of device; then nothing has changed
  virtual void restore(const DeviceMemory& memory) { MemoryReader(memory, 0, name()); }
};

}  // namespace palpate
