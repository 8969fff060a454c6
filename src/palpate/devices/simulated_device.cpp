#include "palpate/devices/simulated_device.h"

#include <Eigen/LU>
#include <cmath>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

/// A hand does not give way further than this under the load of the start; a heavier tool sags.
constexpr double kMaxHandTurn = 1.0;  // [rad]

void require(bool good, const char* key, const char* cause) {
  if (!good) throw InputError("simulated device", key, cause);
}

}  // namespace

SimulatedDevice::SimulatedDevice(const SimulatedDeviceSettings& settings, Path path, const Pose& start)
    : settings_(settings), path_(std::move(path)), start_(start) {
  const auto positive = [](double value) { return value > 0.0 && std::isfinite(value); };
  const auto not_negative = [](double value) { return value >= 0.0 && std::isfinite(value); };
  require(positive(settings.mass), "mass", "must be positive");
  require(positive(settings.inertia), "inertia", "must be positive");
  require(not_negative(settings.damping), "damping", "must not be negative");
  require(not_negative(settings.rotational_damping), "rotational_damping", "must not be negative");
  require(not_negative(settings.hand_stiffness), "hand_stiffness", "must not be negative");
  require(not_negative(settings.hand_damping), "hand_damping", "must not be negative");
  require(not_negative(settings.hand_rotational_stiffness), "hand_rotational_stiffness", "must not be negative");
  require(not_negative(settings.hand_rotational_damping), "hand_rotational_damping", "must not be negative");
  SimulatedDevice::begin(Vec6::Zero());
}

void SimulatedDevice::begin(const Vec6& wrench) noexcept {
  hand_offset_.setZero();  // a hand without springs carries nothing
  if (settings_.hand_stiffness > 0) hand_offset_.head<3>() = -wrench.head<3>() / settings_.hand_stiffness;
  if (settings_.hand_rotational_stiffness > 0) {
    hand_offset_.tail<3>() = -wrench.tail<3>() / settings_.hand_rotational_stiffness;
  }
  const double turn = hand_offset_.tail<3>().norm();
  if (turn > kMaxHandTurn) hand_offset_.tail<3>() *= kMaxHandTurn / turn;
  state_ = DeviceState{path_.at(0.0, start_).pose, Vec6::Zero(), 0};
}

void SimulatedDevice::takeInHand(double stiffness, double damping) noexcept {
  if (stiffness > 0) hand_offset_.head<3>() *= settings_.hand_stiffness / stiffness;
  settings_.hand_stiffness = stiffness;
  settings_.hand_damping = damping;
}

DeviceState SimulatedDevice::sample(double) noexcept { return state_; }

void SimulatedDevice::apply(const Vec6& wrench, double t, double dt) noexcept {
  Path::Point wanted = target(t, dt);
  wanted.pose = advance(wanted.pose, hand_offset_);
  moveLinear(wrench.head<3>(), wanted, dt);
  moveAngular(wrench.tail<3>(), wanted, dt);
}

DeviceMemory SimulatedDevice::save() const {
  DeviceMemory memory;
  append(memory, state_.pose);
  append(memory, state_.twist);
  append(memory, hand_offset_);
  return memory;
}

void SimulatedDevice::restore(const DeviceMemory& memory) {
  MemoryReader reader(memory, kMemory, name());
  read(reader);
}

void SimulatedDevice::read(MemoryReader& memory) noexcept {
  state_.pose = memory.pose();
  state_.twist = memory.vec6();
  hand_offset_ = memory.vec6();
}

void SimulatedDevice::moveLinear(const Vec3& force, const Path::Point& target, double dt) noexcept {
  const double k = settings_.hand_stiffness;
  const double b = settings_.hand_damping;
  Vec3& position = state_.pose.position;
  Vec6& twist = state_.twist;
  const Vec3 forces = force + k * (target.pose.position - position) + b * target.twist.head<3>();
  const double implicit_mass = settings_.mass + dt * (b + settings_.damping) + dt * dt * k;
  const Vec3 velocity = (settings_.mass * twist.head<3>() + dt * forces) / implicit_mass;
  position += dt * velocity;
  twist.head<3>() = velocity;
}

void SimulatedDevice::moveAngular(const Vec3& torque, const Path::Point& target, double dt) noexcept {
  const double k = settings_.hand_rotational_stiffness;
  const double b = settings_.hand_rotational_damping;
  // log(R Rt^T), and how it answers to a turn of R.
  const Vec3 error = logRotation(state_.pose.rotation * target.pose.rotation.conjugate());
  Mat3 matrix = dt * dt * k * leftJacobianInverse(error);
  matrix.diagonal().array() += settings_.inertia + dt * (b + settings_.rotational_damping);
  const Vec3 spin = state_.twist.tail<3>();
  const Vec3 rhs = settings_.inertia * spin + dt * (torque - k * error + b * target.twist.tail<3>());
  const Vec3 next = matrix.inverse() * rhs;
  Vec6 turn;
  turn << Vec3::Zero(), dt * next;
  state_.pose = advance(state_.pose, turn);
  state_.twist.tail<3>() = next;
}

}  // namespace palpate
