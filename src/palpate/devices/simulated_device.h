#pragma once

#include "palpate/devices/device.h"
#include "palpate/devices/path.h"

namespace palpate {

/// What moves a simulated device, and what it is made of. The device balances its own weight.
struct SimulatedDeviceSettings {
  // Phantom Omni (SensAble data sheet): apparent mass at the tip about 45 g. The rest is ours: the sheet has friction
  // (0.26 N to back-drive) in place of damping, and says nothing about the stylus's inertia, which is that of a 45 g
  // pen turning about a point 5 cm from its middle.
  double mass = 0.045;               ///< [kg]
  double damping = 0.2;              ///< [N s/m]
  double inertia = 1.1e-4;           ///< the same about every axis [kg m^2]
  double rotational_damping = 5e-4;  ///< [N m s/rad]
  // Hand: a spring and a damper from the device to where the hand wants it, about critical for the mass above.
  double hand_stiffness = 500.0;           ///< [N/m]
  double hand_damping = 8.0;               ///< [N s/m]
  double hand_rotational_stiffness = 2.0;  ///< [N m/rad]
  double hand_rotational_damping = 0.03;   ///< [N m s/rad]
  DeviceLimits limits;
};

/// A device's mass, moved by a hand model along a path and by the wrench that it renders:
///   m a = f + kh (xt - x) + bh (vt - v) - b v,   and likewise for rotation.
/// Backward Euler over each tick, with the wrench held and the target at the tick's end: stable for any dt.
class SimulatedDevice : public Device {
 public:
  /// @param path   of the hand, relative to `start`
  /// @param start  pose at t = 0, at rest there
  /// @throws InputError for a mass or inertia that is not positive, or stiffness and damping that are negative. Without
  ///         stiffness nobody holds the device.
  SimulatedDevice(const SimulatedDeviceSettings& settings, Path path, const Pose& start);

  const char* name() const noexcept override { return "simulated"; }
  DeviceLimits limits() const noexcept override { return settings_.limits; }
  /// Puts the device at the path's beginning, at rest, with a hand in equilibrium: its target is moved, for the whole
  /// run, by what its springs give under the load.
  void begin(const Vec6& wrench) noexcept override;
  /// State at the end of the last apply(); t only says when that is.
  DeviceState sample(double t) noexcept override;
  void apply(const Vec6& wrench, double t, double dt) noexcept override;
  DeviceMemory save() const override;
  void restore(const DeviceMemory& memory) override;

 protected:
  /// Where the hand wants the device at the end of the tick [t, t + dt), before begin()'s offset.
  virtual Path::Point target(double t, double dt) noexcept { return path_.at(t + dt, start_); }
  /// Another hand from the next tick on; what it carried at the start it carries in its own springs.
  void takeInHand(double stiffness, double damping) noexcept;
  const Pose& startPose() const noexcept { return start_; }
  const Path& path() const noexcept { return path_; }

  /// How many numbers save() gives.
  static constexpr std::size_t kMemory = 19;
  void read(MemoryReader& memory) noexcept;

 private:
  void moveLinear(const Vec3& force, const Path::Point& target, double dt) noexcept;
  void moveAngular(const Vec3& torque, const Path::Point& target, double dt) noexcept;

  SimulatedDeviceSettings settings_;
  Path path_;
  Pose start_;
  Vec6 hand_offset_ = Vec6::Zero();  // of the target, against the load at the start
  DeviceState state_;
};

}  // namespace palpate
