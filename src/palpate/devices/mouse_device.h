#pragma once

#include <atomic>
#include <cstdint>

#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/exchange.h"

namespace palpate {

/// What a person on a screen wants of the device; from one thread to the haptic tick.
struct HandCommand {
  enum class Driver : std::uint8_t {
    path,  ///< the device's own path drives the hand
    hand,  ///< the pose does
  };
  Driver driver = Driver::path;
  Pose pose;                   ///< where the hand wants the device, world
  std::uint32_t sequence = 0;  ///< of the message, for measuring delay
  std::uint32_t plays = 0;     ///< how often the path has been begun anew
};

/// How a pointer's steps become a hand's motion.
struct MouseSettings {
  double max_speed = 2.0;   ///< of the hand's target [m/s]
  double max_spin = 20.0;   ///< [rad/s]
  double interval = 0.02;   ///< time in which the target reaches a new pose, if the limits allow [s]; a display frame
  double max_reach = 0.75;  ///< farthest that the target goes from the start [m]
};

/// A simulated device whose hand is a person's at a pointer, or, until somebody takes it, the scene's own path. What
/// the person sends moves the hand's target, never faster than the limits; the hand's spring, the device's mass and
/// everything behind them are those of any simulated device.
class MouseDevice final : public SimulatedDevice {
 public:
  /// @param path  that drives the hand at first; may be empty
  MouseDevice(const SimulatedDeviceSettings& settings, Path path, const Pose& start, const MouseSettings& mouse = {});

  const char* name() const noexcept override { return "mouse"; }
  /// With the last command that a tick has taken; one that waits still comes from outside and is not remembered.
  DeviceMemory save() const override;
  /// While nobody calls command(): a command that no tick has taken is forgotten.
  void restore(const DeviceMemory& memory) override;

  /// From one thread, any time; the tick takes the newest. A pose that is not finite or no rotation is ignored.
  void command(const HandCommand& command) noexcept;
  /// Sequence of the last command that a tick has taken; any thread.
  std::uint32_t taken() const noexcept { return taken_.load(std::memory_order_relaxed); }
  /// Where the hand's target is; any thread that does not run while the device ticks.
  const Pose& handTarget() const noexcept { return target_.pose; }

 protected:
  Path::Point target(double t, double dt) noexcept override;

 private:
  MouseSettings mouse_;
  LatestValue<HandCommand> commands_;
  HandCommand current_;
  Path::Point target_;
  double path_start_ = 0.0;  // [s]
  double left_ = 0.0;        // of the interval [s]
  std::atomic<std::uint32_t> taken_{0};
};

}  // namespace palpate
