#pragma once

#include "palpate/haptics/coupling.h"
#include "palpate/haptics/tick_flags.h"
#include "palpate/linearization/handle_model.h"

namespace palpate {

/// The proxy: a copy of the handle that lives in the haptic loop.
struct ProxySettings {
  double mass = 0.05;                      ///< of handle and attached nodes [kg]
  Mat3 inertia = 1e-5 * Mat3::Identity();  ///< about the origin, body axes [kg m^2]
  Vec3 gravity = Vec3(0.0, 0.0, -9.81);    ///< [m/s^2]; the origin is the center of mass, so weight has no moment
  // Bounds that only a broken model or device reaches; they keep every number in the tick finite.
  double max_stretch = 0.25;  ///< distance of the proxy from the device [m]
  double max_turn = 2.5;      ///< angle between proxy and device [rad]; below pi, where the link's torque would jump
  double max_speed = 20.0;    ///< [m/s]
  double max_spin = 200.0;    ///< [rad/s]
  double max_model_rotation = 2.0;  ///< angle from the model's reference beyond which Kx sees no more rotation [rad]
};

/// Where the proxy is; all that it remembers.
struct ProxyState {
  Pose pose;
  Vec6 twist = Vec6::Zero();
};

/// One tick of the proxy as a linear system for the change of its twist, A du = b.
struct ProxySystem {
  Mat6 matrix;  ///< A [kg, kg m; kg m, kg m^2]
  Vec6 rhs;     ///< b [N s; N m s]
  TickFlags flags;
};

/// Rigid proxy of the handle, pulled by the handle model on one side and by the link to the device on the other. A tick
/// is one Newton step, from u' = u, of implicit Euler
///   M (u' - u) / dt = F*(x', u') - link(x', u') + weight - (0, w' x I w'),     x' = x advanced by dt u'
/// that is one 6x6 system. It is exact where the forces are linear, e.g. in the one-dimensional experiment.
class HandleProxy {
 public:
  /// @throws InputError for a mass or inertia that is not positive definite, or a bound that is not positive
  explicit HandleProxy(const ProxySettings& settings);

  /// Puts the proxy somewhere, at a twist.
  void reset(const Pose& pose, const Vec6& twist) noexcept;

  /// Advances the proxy by dt [s]. Without a model (nullptr) only link and weight act.
  TickFlags step(const HandleModel* model, const LinkParameters& link, const DeviceState& device, double dt) noexcept;

  /// Advances the proxy by dt at a twist found elsewhere; with step()'s bounds.
  TickFlags move(const Vec6& twist, const DeviceState& device, double dt) noexcept;

  /// The system that step() solves, before any projection: A = M - dt C + dt (B + dt K P) + dt dG/dw with
  /// C = dt Kx P + Kv, P the derivative of log(exp(dt w') R R0^T) by dt w'.
  ProxySystem assemble(const HandleModel* model, const LinkParameters& link, const DeviceState& device,
                       double dt) const noexcept;

  ProxyState state() const noexcept { return {pose_, twist_}; }
  void restore(const ProxyState& state) noexcept { reset(state.pose, state.twist); }

  const Pose& pose() const noexcept { return pose_; }
  const Vec6& twist() const noexcept { return twist_; }
  const ProxySettings& settings() const noexcept { return settings_; }

 private:
  struct Parts;
  Parts evaluate(const HandleModel* model, const LinkParameters& link, const DeviceState& device,
                 double dt) const noexcept;
  void addBody(Parts& parts, double dt) const noexcept;
  void addModel(Parts& parts, const HandleModel& model, const Pose& predicted, const Mat3& left_jacobian,
                double dt) const noexcept;
  Vec6 solve(const Parts& parts, double dt, TickFlags& flags) const noexcept;
  void limit(const DeviceState& device, TickFlags& flags) noexcept;

  ProxySettings settings_;
  Pose pose_;
  Vec6 twist_ = Vec6::Zero();
};

}  // namespace palpate
