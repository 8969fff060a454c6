#pragma once

#include <atomic>
#include <limits>
#include <memory>

#include "palpate/devices/device.h"
#include "palpate/devices/device_options.h"
#include "palpate/devices/driver.h"
#include "palpate/devices/motor_heat.h"

namespace palpate {

/// How a device on a desk and the scene lie to each other.
struct WorkspaceSettings {
  double motion_scale = 1.0;  ///< the handle's motion for the device's
  double force_scale = 1.0;   ///< the device's force for the scene's
  double turn = 0.0;          ///< of the device's frame in the world, about z [rad]; 0: x right, y away from the person
  int clutch = 2;             ///< button that takes the handle off the device; 0: none
  double border = 0.9;        ///< share of the workspace's radius beyond which the handle goes on by itself
  double border_speed = 0.1;  ///< at the end of the workspace, in the world [m/s]; 0: it does not
  double heat_time = 30.0;    ///< of the motors [s]
  double patience = 10.0;     ///< for which a lost device may stay away [s]
  // What the person wants of the device at most, where it could do more [N].
  double peak_force = std::numeric_limits<double>::infinity();
  double continuous_force = std::numeric_limits<double>::infinity();
};

/// @throws InputError for a value out of range
WorkspaceSettings workspaceSettings(const DeviceOptions& options);
/// The options that it knows.
const std::vector<DeviceOption>& workspaceOptions();

/// The device's own limits, not above what is wanted.
DeviceLimits wantedLimits(DeviceLimits limits, const WorkspaceSettings& settings);

/// Limits in the world of what a device renders with these scales at a tick of this length [s]: stiffness and damping
/// that it would feel more strongly are the smaller, and as K T must not grow (Colgate and Schenkel 1997: passive if
/// b > K T / 2 + |B|), also where the tick is longer than the device's own.
DeviceLimits worldLimits(const DriverInfo& info, const WorkspaceSettings& settings, double tick);

/// A device on a desk: the driver's frame in the world, scales, clutch, border; its loss, and the heat of its motors.
///   p = p_a + s Rz (pd - pd_a),   R = Rz Rd Rd_a^T Rz^T R_a,   s: motion scale; a: where device and handle were joined
/// They are joined at the first sample, and anew after the clutch, a loss or a jump.
class HardwareDevice final : public Device {
 public:
  /// @param start  of the handle, world; the device is joined to it wherever it is
  HardwareDevice(std::shared_ptr<DeviceDriver> driver, const WorkspaceSettings& settings, const Pose& start);
  ~HardwareDevice() override;
  HardwareDevice(const HardwareDevice&) = delete;
  HardwareDevice& operator=(const HardwareDevice&) = delete;

  const char* name() const noexcept override { return driver_->info().name.c_str(); }
  DeviceLimits limits() const noexcept override { return limits_; }
  DeviceState sample(double t) noexcept override;
  void apply(const Vec6& wrench, double t, double dt) noexcept override;
  bool keepsTime() const noexcept override { return driver_->keepsTime(); }
  void run(const std::function<bool()>& tick) override { driver_->run(tick); }
  bool isReal() const noexcept override { return true; }
  const char* failure() const noexcept override;
  DeviceReport report() const override;

 private:
  bool isSane(const DriverSample& sample) const noexcept;
  bool follows(const DriverSample& sample, double t, double dt) noexcept;
  void join(const DriverSample& sample) noexcept;
  void place(const DriverSample& sample, double dt) noexcept;
  void index(const DriverSample& sample, double dt) noexcept;
  void updateGain(bool held, double dt) noexcept;

  std::shared_ptr<DeviceDriver> driver_;
  WorkspaceSettings settings_;
  DeviceLimits limits_;       // in the device's frame
  Quat frame_;                // device to world
  MotorHeat heat_;            // of what the device gives
  Pose joint_;                // of the handle, world ...
  Pose device_joint_;         // ... and of the device then
  DriverSample last_;         // that was followed
  Vec3 seen_ = Vec3::Zero();  // newest position, followed or not [m]
  double last_time_ = 0.0, followed_time_ = 0.0, seen_time_ = 0.0, steady_since_ = 0.0;  // [s]
  bool started_ = false, joined_ = false, inside_ = false, strayed_ = false, clutched_ = false, lost_ = false;
  double gain_ = 0.0;
  Vec6 drift_ = Vec6::Zero();
  DeviceState state_;
  DeviceReport counts_;
  std::atomic<bool> given_up_{false};
};

}  // namespace palpate
