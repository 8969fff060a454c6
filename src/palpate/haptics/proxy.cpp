#include "palpate/haptics/proxy.h"

#include "palpate/common/error.h"
#include "palpate/math/decompositions.h"

namespace palpate {
namespace {

/// Symmetric part of A must keep this share of M, or the active part of the model's derivative is taken explicitly. At
/// 0.1, an active model's velocity grows at most tenfold in a tick, and A's condition (scaled by M) stays bounded.
constexpr double kDefiniteness = 0.1;

/// log(exp(dt w') R R0^T) at w' = w and its derivative by (dt w').
struct RotationError {
  Vec3 angle;
  Mat3 derivative;
};

RotationError rotationError(const Quat& predicted, const Quat& reference, const Mat3& left_jacobian) {
  RotationError error;
  error.angle = logRotation(predicted * reference.conjugate());
  error.derivative.noalias() = leftJacobianInverse(error.angle) * left_jacobian;
  return error;
}

Mat6 withRotationColumns(const Mat6& stiffness, const Mat3& derivative) {
  Mat6 result = stiffness;
  result.rightCols<3>() = (stiffness.rightCols<3>() * derivative).eval();
  return result;
}

bool isDefinite(const Mat6& matrix, const Mat6& mass) {
  return isPositiveDefinite(Mat6(0.5 * (matrix + matrix.transpose()) - kDefiniteness * mass));
}

/// Without the positive eigenvalues of the symmetric part; what is left takes energy out or turns it sideways.
Mat6 passivePart(const Mat6& derivative) {
  const SymmetricEigen6 eigen = symmetricEigen(Mat6(0.5 * (derivative + derivative.transpose())));
  const Vec6 active = eigen.values.cwiseMax(0.0);
  return derivative - eigen.vectors * active.asDiagonal() * eigen.vectors.transpose();
}

void requirePositive(double value, const char* key) {
  if (!(value > 0.0) || !std::isfinite(value)) throw InputError("proxy", key, "must be positive");
}

}  // namespace

/// Pieces of the system, in coordinates scaled such that M is near the identity: u = scale * u_scaled.
struct HandleProxy::Parts {
  Vec6 scale;       // 1 / sqrt(mass), 1 / sqrt(mean inertia)
  Mat6 mass;        // M
  Mat6 link;        // B + dt K P
  Mat6 gyroscopic;  // d(w x I w)/dw
  Mat6 derivative;  // C = dt Kx P + Kv
  Vec6 rhs;         // dt times all forces at the predicted state
  TickFlags flags;
};

HandleProxy::HandleProxy(const ProxySettings& settings) : settings_(settings) {
  requirePositive(settings.mass, "mass");
  requirePositive(settings.max_stretch, "max_stretch");
  requirePositive(settings.max_turn, "max_turn");
  requirePositive(settings.max_speed, "max_speed");
  requirePositive(settings.max_spin, "max_spin");
  requirePositive(settings.max_model_rotation, "max_model_rotation");
  if (!settings.gravity.allFinite()) throw InputError("proxy", "gravity", "must be finite");
  const bool symmetric = (settings.inertia - settings.inertia.transpose()).norm() <= 1e-9 * settings.inertia.norm();
  if (!settings.inertia.allFinite() || !symmetric || !isPositiveDefinite(MatX(settings.inertia)))
    throw InputError("proxy", "inertia", "must be symmetric and positive definite");
}

void HandleProxy::reset(const Pose& pose, const Vec6& twist) noexcept {
  pose_ = pose;
  twist_ = twist;
}

HandleProxy::Parts HandleProxy::evaluate(const HandleModel* model, const LinkParameters& whole,
                                         const DeviceState& device, double dt) const noexcept {
  Parts parts;
  addBody(parts, dt);
  const LinkParameters link = saturated(whole, pose_, twist_, device.pose, device.twist);
  const Pose predicted = advance(pose_, dt * twist_);
  const Mat3 left_jacobian = leftJacobian(dt * twist_.tail<3>());

  const Mat3 turn = rotationError(predicted.rotation, device.pose.rotation, left_jacobian).derivative;
  parts.link.setZero();
  parts.link.topLeftCorner<3, 3>().diagonal().setConstant(link.damping + dt * link.stiffness);
  parts.link.bottomRightCorner<3, 3>() = dt * link.rotational_stiffness * turn;
  parts.link.bottomRightCorner<3, 3>().diagonal().array() += link.rotational_damping;
  parts.rhs -= dt * linkWrenchOnDevice(link, predicted, twist_, device.pose, device.twist);

  parts.derivative.setZero();
  if (model) addModel(parts, *model, predicted, left_jacobian, dt);
  return parts;
}

void HandleProxy::addBody(Parts& parts, double dt) const noexcept {
  const Vec3 spin = twist_.tail<3>();
  const Mat3 rotation = pose_.matrix();
  const Mat3 inertia = rotation * settings_.inertia * rotation.transpose();
  const Vec3 momentum = inertia * spin;
  parts.scale << Vec3::Constant(1.0 / std::sqrt(settings_.mass)), Vec3::Constant(std::sqrt(3.0 / inertia.trace()));
  parts.mass.setZero();
  parts.mass.topLeftCorner<3, 3>().diagonal().setConstant(settings_.mass);
  parts.mass.bottomRightCorner<3, 3>() = inertia;
  parts.gyroscopic.setZero();
  parts.gyroscopic.bottomRightCorner<3, 3>() = skew(spin) * inertia - skew(momentum);
  parts.rhs << dt * settings_.mass * settings_.gravity, -dt * spin.cross(momentum);
}

void HandleProxy::addModel(Parts& parts, const HandleModel& model, const Pose& predicted, const Mat3& left_jacobian,
                           double dt) const noexcept {
  RotationError error = rotationError(predicted.rotation, model.pose.rotation, left_jacobian);
  const double angle = error.angle.norm();
  if (angle > settings_.max_model_rotation) {
    error.angle *= settings_.max_model_rotation / angle;
    error.derivative.setZero();
    parts.flags.set(TickFlag::model_rotation_clamped);
  }
  Vec6 offset;
  offset << predicted.position - model.pose.position, error.angle;
  parts.rhs += dt * (model.force + model.kx * offset + model.kv * (twist_ - model.twist));
  parts.derivative = dt * withRotationColumns(model.kx, error.derivative) + model.kv;
}

ProxySystem HandleProxy::assemble(const HandleModel* model, const LinkParameters& link, const DeviceState& device,
                                  double dt) const noexcept {
  const Parts parts = evaluate(model, link, device, dt);
  return {parts.mass + dt * (parts.link + parts.gyroscopic - parts.derivative), parts.rhs, parts.flags};
}

Vec6 HandleProxy::solve(const Parts& parts, double dt, TickFlags& flags) const noexcept {
  const auto scaled = [&](const Mat6& m) -> Mat6 { return parts.scale.asDiagonal() * m * parts.scale.asDiagonal(); };
  const Mat6 mass = scaled(parts.mass);
  const Mat6 passive = mass + dt * scaled(parts.link);
  Mat6 gyroscopic = dt * scaled(parts.gyroscopic);
  Mat6 derivative = dt * scaled(parts.derivative);
  Mat6 matrix = passive + gyroscopic - derivative;
  if (!isDefinite(matrix, mass)) {
    // Force as it is, at the predicted state; only its implicit part loses what would feed the motion.
    flags.set(TickFlag::stiffness_projected);
    derivative = passivePart(derivative);
    matrix = passive + gyroscopic - derivative;
    if (!isDefinite(matrix, mass)) matrix = passive - derivative;
  }
  const Vec6 rhs = parts.scale.cwiseProduct(parts.rhs);
  return parts.scale.cwiseProduct(palpate::solve(matrix, rhs));
}

TickFlags HandleProxy::step(const HandleModel* model, const LinkParameters& link, const DeviceState& device,
                            double dt) noexcept {
  const Parts parts = evaluate(model, link, device, dt);
  TickFlags flags = parts.flags;
  const Vec6 change = solve(parts, dt, flags);
  flags |= move(twist_ + change, device, dt);
  return flags;
}

TickFlags HandleProxy::move(const Vec6& twist, const DeviceState& device, double dt) noexcept {
  TickFlags flags;
  twist_ = twist;
  pose_ = advance(pose_, dt * twist_);
  if (!twist_.allFinite() || !pose_.allFinite()) {
    reset(device.pose, device.twist);
    flags.set(TickFlag::proxy_reset);
  }
  limit(device, flags);
  return flags;
}

void HandleProxy::limit(const DeviceState& device, TickFlags& flags) noexcept {
  // A part of the tangent that is too long is cut, and the motion that would lengthen it again with it.
  const auto cut = [&](Eigen::Ref<Vec3> value, double bound) {
    const double length = value.norm();
    if (length <= bound) return false;
    value *= bound / length;
    flags.set(TickFlag::proxy_limited);
    return true;
  };
  Vec6 twist = twist_;
  cut(twist.head<3>(), settings_.max_speed);
  cut(twist.tail<3>(), settings_.max_spin);

  Vec6 stretch = poseDifference(pose_, device.pose);
  const bool far = cut(stretch.head<3>(), settings_.max_stretch);
  const bool turned = cut(stretch.tail<3>(), settings_.max_turn);
  const auto stopOutward = [&](Eigen::Ref<Vec3> rate, const Vec3& device_rate, const Vec3& direction) {
    rate -= std::max(0.0, (rate - device_rate).dot(direction)) * direction;
  };
  if (far) stopOutward(twist.head<3>(), device.twist.head<3>(), stretch.head<3>().normalized());
  if (turned) stopOutward(twist.tail<3>(), device.twist.tail<3>(), stretch.tail<3>().normalized());
  if (far || turned) pose_ = advance(device.pose, stretch);
  twist_ = twist;
}

}  // namespace palpate
