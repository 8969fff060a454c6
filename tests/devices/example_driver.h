#pragma once

#include <cmath>

#include "palpate/common/error.h"
#include "palpate/devices/driver.h"

// What the makers of an imaginary lever give: one axis along y, away from the person.
extern "C" {
int lever_open();                    // 0: good
int lever_position(double* metres);  // 0: good
int lever_force(double newtons);     // 0: good; stays until the next one
}

namespace palpate {

/// A whole driver. Handed to HardwareDevice, the lever has frame, scales, clutch, heat, loss and safety; a line in
/// driverKinds() (devices/driver_list.cpp) gives it a name for --device.
class LeverDriver final : public DeviceDriver {
 public:
  LeverDriver() {
    if (lever_open() != 0) throw RunError("lever: it does not answer: is it plugged in?");
    info_.name = "Lever";
    info_.limits.peak_force = 4.0;         // N
    info_.limits.continuous_force = 1.0;   // N
    info_.limits.peak_torque = 0.0;        // it has none
    info_.limits.stiffness = 800.0;        // N/m, at `rate`
    info_.limits.damping = 2.0;            // N s/m
    info_.limits.workspace_radius = 0.05;  // m
    info_.rate = 1000.0;
    info_.has_velocity = false;  // it is taken from positions
  }
  ~LeverDriver() override { LeverDriver::release(); }

  const DriverInfo& info() const noexcept override { return info_; }
  bool read(DriverSample& sample) noexcept override {
    double y = 0;
    if (lever_position(&y) != 0) return false;
    sample.pose.position = Vec3(0, y, 0);  // x right, y away from the person, z up
    return true;
  }
  void write(const Vec6& wrench) noexcept override { lever_force(wrench[1]); }
  void release() noexcept override { lever_force(0); }

 private:
  DriverInfo info_;
};

}  // namespace palpate
