#pragma once

#include <algorithm>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/devices/device.h"
#include "palpate/devices/path.h"
#include "palpate/haptics.h"
#include "palpate/haptics/haptic_loop.h"

namespace palpate::library {

// Between what include/palpate declares, v0::, and the rooms' own types.

inline Vec3 from(const v0::Vector3& v) { return {v[0], v[1], v[2]}; }
inline Vec6 from(const v0::Vector6& v) { return Eigen::Map<const Vec6>(v.data()); }
inline Mat3 from(const v0::Matrix3& m) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(m.data());
}
inline Mat6 from(const v0::Matrix6& m) {
  return Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(m.data());
}
inline Pose from(const v0::Pose& p) {
  return {from(p.position), Quat(p.rotation[0], p.rotation[1], p.rotation[2], p.rotation[3])};
}

inline v0::Vector3 to(const Vec3& v) { return {v.x(), v.y(), v.z()}; }
inline v0::Vector6 to(const Vec6& v) {
  v0::Vector6 out;
  Eigen::Map<Vec6>(out.data()) = v;
  return out;
}
inline v0::Matrix3 to(const Mat3& m) {
  v0::Matrix3 out;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(out.data()) = m;
  return out;
}
inline v0::Matrix6 to(const Mat6& m) {
  v0::Matrix6 out;
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(out.data()) = m;
  return out;
}
inline v0::Pose to(const Pose& p) {
  return {to(p.position), {p.rotation.w(), p.rotation.x(), p.rotation.y(), p.rotation.z()}};
}

inline DeviceState from(const v0::DeviceState& s) {
  return {from(s.pose), from(s.twist), s.buttons, s.force_limit, s.torque_limit};
}
inline v0::DeviceState to(const DeviceState& s) {
  return {to(s.pose), to(s.twist), s.buttons, s.force_limit, s.torque_limit};
}

inline DeviceLimits from(const v0::DeviceLimits& l) {
  return {l.peak_force, l.continuous_force,     l.peak_torque,        l.stiffness,
          l.damping,    l.rotational_stiffness, l.rotational_damping, l.workspace_radius};
}
inline v0::DeviceLimits to(const DeviceLimits& l) {
  return {l.peak_force, l.continuous_force,     l.peak_torque,        l.stiffness,
          l.damping,    l.rotational_stiffness, l.rotational_damping, l.workspace_radius};
}

inline LinkParameters from(const v0::Link& l) {
  return {l.stiffness, l.damping, l.rotational_stiffness, l.rotational_damping, l.peak_force, l.peak_torque};
}
inline v0::Link to(const LinkParameters& l) {
  return {l.stiffness, l.damping, l.rotational_stiffness, l.rotational_damping, l.peak_force, l.peak_torque};
}

inline HandleModel from(const v0::HandleModel& m) {
  return {from(m.force),       from(m.pose),         from(m.twist), from(m.kx), from(m.kv),
          from(m.handle_pose), from(m.handle_twist), m.time,        m.step,     m.unsound};
}
inline v0::HandleModel to(const HandleModel& m) {
  return {to(m.force),       to(m.pose),         to(m.twist), to(m.kx), to(m.kv),
          to(m.handle_pose), to(m.handle_twist), m.time,      m.step,   m.unsound};
}

inline v0::Tick to(const TickRecord& r) {
  return {r.time,     to(r.device), to(r.proxy),        to(r.proxy_twist), to(r.raw),
          to(r.sent), r.model_age,  r.delivered_energy, r.flags.bits()};
}

// Either way: the fields of both have the same order.
template <typename Out, typename In>
Out safetyAs(const In& s) {
  Out out{s.peak_force,
          s.peak_torque,
          s.max_slew,
          s.max_torque_slew,
          s.start_ramp,
          s.model_age_limit,
          s.model_decay,
          s.gap_limit,
          s.gap_ramp,
          s.end_fade,
          {},
          {},
          {}};
  const auto& p = s.passivity;
  out.passivity = {p.enabled, p.allowance, p.max_damping, p.max_rotational_damping, p.quiet_speed, p.quiet_spin};
  const auto& o = s.oscillation;
  out.oscillation = {o.enabled, o.band, o.window, o.windows, o.power, o.fade, o.rest, o.ramp, o.share, o.recovery};
  const auto& h = s.presence;
  out.presence = {h.dead_man,  h.start_gate, h.push,      h.push_time,    h.push_travel,  h.calm_speed,
                  h.calm_time, h.gate_ramp,  h.workspace, h.frozen_limit, h.frozen_force, h.fade};
  return out;
}
inline SafetySettings from(const v0::Safety& s) { return safetyAs<SafetySettings>(s); }
inline v0::Safety to(const SafetySettings& s) { return safetyAs<v0::Safety>(s); }

inline ProxySettings from(const v0::Proxy& p) {
  return {p.mass,     from(p.inertia), from(p.gravity), p.max_stretch,
          p.max_turn, p.max_speed,     p.max_spin,      p.max_model_rotation};
}
inline v0::Proxy to(const ProxySettings& p) {
  return {p.mass,     to(p.inertia), to(p.gravity), p.max_stretch,
          p.max_turn, p.max_speed,   p.max_spin,    p.max_model_rotation};
}

inline HapticSettings from(const v0::HapticSettings& s) {
  const bool coupled = s.rendering == v0::Rendering::virtual_coupling;
  HapticSettings out;
  out.dt = s.step;
  out.rendering = coupled ? Rendering::virtual_coupling : Rendering::linearized;
  out.link = from(s.link);
  out.proxy = from(s.proxy);
  out.compensation = {from(s.compensated_weight), from(s.compensated_center)};
  out.safety = from(s.safety);
  return out;
}
/// Method live becomes `linearized`.
inline v0::HapticSettings to(const HapticSettings& s) {
  const bool coupled = s.rendering == Rendering::virtual_coupling;
  return {s.dt,
          coupled ? v0::Rendering::virtual_coupling : v0::Rendering::linearized,
          to(s.link),
          to(s.proxy),
          to(s.compensation.weight),
          to(s.compensation.center),
          to(s.safety)};
}

inline Path from(const v0::Path& path) {
  std::vector<PathKey> keys;
  for (const v0::Keyframe& k : path.keyframes) keys.push_back({k.time, from(k.position), from(k.rotation)});
  return Path(std::move(keys), path.smooth ? Interpolation::smooth : Interpolation::linear);
}

/// Calls f; what the rooms throw comes out as what include/palpate declares.
template <class F>
decltype(auto) guarded(F&& f) {
  try {
    return std::forward<F>(f)();
  } catch (const InputError& e) {
    throw v0::InputError(e.file(), e.key(), e.cause());
  } catch (const RunError& e) {
    throw v0::RunError(e.what());
  }
}

/// A user's device for the rooms.
class AdoptedDevice final : public Device {
 public:
  AdoptedDevice(v0::Device& device, const Pose& start) : device_(device), start_(to(start)) {}
  const char* name() const noexcept override { return device_.name(); }
  DeviceLimits limits() const noexcept override { return from(device_.limits()); }
  void begin(const Vec6& wrench) noexcept override { device_.begin(start_, to(wrench)); }
  DeviceState sample(double t) noexcept override { return from(device_.sample(t)); }
  void apply(const Vec6& wrench, double t, double dt) noexcept override { device_.apply(to(wrench), t, dt); }
  bool keepsTime() const noexcept override { return device_.keepsTime(); }
  void run(const std::function<bool()>& tick) override { device_.run(tick); }
  bool isReal() const noexcept override { return device_.isReal(); }
  const char* failure() const noexcept override { return device_.failure(); }
  DeviceMemory save() const override { return device_.save(); }
  void restore(const DeviceMemory& memory) override { device_.restore(memory); }

 private:
  v0::Device& device_;
  v0::Pose start_;
};

}  // namespace palpate::library
