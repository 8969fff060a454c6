#include "palpate/study/stress_hand.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

constexpr double kTurnReach = 2.5;                   // of a ride [rad]
constexpr double kAcceleration = 0.1;                // to full speed [s]
constexpr double kFinest = 0.001;                    // of a ride's own steps [s]
constexpr double kHomeSpeed = 0.3, kHomeSpin = 3.0;  // [m/s], [rad/s]
constexpr double kApproach = 0.05;                   // last part of the way home: its time constant [s]
constexpr double kArrived = 1e-6;                    // [m], [rad]

int stepsIn(double time, double step) { return std::max(1, static_cast<int>(std::ceil(time / step - 1e-9))); }

double uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

Vec3 direction(std::mt19937_64& random) {
  Vec3 d;
  do {
    d = Vec3(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1));
  } while (d.norm() > 1 || d.norm() < 1e-3);
  return d.normalized();
}

Vec3 shortened(const Vec3& v, double most) {
  const double length = v.norm();
  return length > most ? Vec3(most / length * v) : v;
}

// A velocity without what would carry `away` out of the reach: half of the acceleration is to stop it in time.
Vec3 turnedInwards(const Vec3& velocity, const Vec3& away, double reach, double acceleration) {
  const double distance = away.norm();
  if (distance < 1e-12) return velocity;
  const Vec3 outwards = away / distance;
  const double fast = velocity.dot(outwards) - std::sqrt(acceleration * std::max(0.0, reach - distance));
  return fast > 0 ? Vec3(velocity - fast * outwards) : velocity;
}

/// Of a ride: the hand in steps of a millisecond at most.
class RidingHand {
 public:
  RidingHand(const Pose& start, const StressMotion& motion, std::uint64_t seed)
      : start_(start), motion_(motion), random_(seed), parts_(stepsIn(motion.step, kFinest)) {
    state_.pose = start;
  }

  const DeviceTarget& ride() {
    for (int k = 0; k < parts_; ++k) {
      if (left_ <= 0) choose();
      left_ -= dt();
      move(velocity_, spin_);
    }
    return state_;
  }

  const DeviceTarget& goHome() {
    for (int k = 0; k < parts_ && !home(); ++k) {
      move(shortened(-away() / kApproach, std::min(kHomeSpeed, motion_.speed)),
           shortened(-turned() / kApproach, std::min(kHomeSpin, motion_.spin)));
    }
    if (home()) state_ = {start_, Vec6::Zero()};
    return state_;
  }

  bool home() const { return away().norm() < kArrived && turned().norm() < kArrived; }

 private:
  double dt() const { return motion_.step / parts_; }
  Vec3 away() const { return state_.pose.position - start_.position; }
  Vec3 turned() const { return logRotation(state_.pose.rotation * start_.rotation.conjugate()); }

  void choose() {
    left_ = uniform(random_, 0.05, 0.4);
    velocity_ = uniform(random_, 0.2, 1) * motion_.speed * direction(random_);
    spin_ = uniform(random_, 0, 1) * motion_.spin * direction(random_);
  }

  void move(const Vec3& velocity, const Vec3& spin) {
    const double a = motion_.speed / kAcceleration, b = motion_.spin / kAcceleration;
    Vec3 v = state_.twist.head<3>(), w = state_.twist.tail<3>();
    v += shortened(turnedInwards(velocity, away(), motion_.reach, a) - v, a * dt());
    w += shortened(turnedInwards(spin, turned(), kTurnReach, b) - w, b * dt());
    // what went round a bend may come to the end of the reach all the same
    const Vec3 before = away();
    const Vec3 after = shortened(before + dt() * v, motion_.reach);
    const Quat rotation = (expRotation(dt() * w) * state_.pose.rotation).normalized();
    if (logRotation(rotation * start_.rotation.conjugate()).norm() <= kTurnReach) {
      state_.pose.rotation = rotation;
    } else {
      w.setZero();
    }
    state_.pose.position = start_.position + after;
    state_.twist.head<3>() = (after - before) / dt();
    state_.twist.tail<3>() = w;
  }

  Pose start_;
  StressMotion motion_;
  std::mt19937_64 random_;
  int parts_;
  DeviceTarget state_;
  double left_ = 0;  // until another velocity is chosen [s]
  Vec3 velocity_ = Vec3::Zero(), spin_ = Vec3::Zero();
};

}  // namespace

WildHand::WildHand(const Pose& start, const StressMotion& motion, std::uint64_t seed)
    : start_(start), motion_(motion), random_(seed) {
  state_.pose = start;
}

StressBout WildHand::bout(int most) {
  StressBout out;
  const int calm = stepsIn(motion_.calm, motion_.step);
  const int steps = std::min(most, stepsIn(motion_.burst, motion_.step) + calm);
  out.calm = std::min(steps, calm);
  for (int n = 0; n < steps; ++n) {
    if (n < steps - out.calm) {
      move();
    } else {
      state_.twist.setZero();
    }
    out.way.push_back(state_);
  }
  return out;
}

void WildHand::move() {
  const double event = uniform(random_, 0, 1);
  if (event < 0.04) {
    teleport();
  } else if (event < 0.16) {
    state_.twist = -state_.twist;
  } else if (event < 0.34) {
    state_.twist.head<3>() = uniform(random_, 0.2, 1) * motion_.speed * direction(random_);
    state_.twist.tail<3>() = uniform(random_, 0, 1) * motion_.spin * direction(random_);
  }
  state_.pose = advance(state_.pose, motion_.step * state_.twist);
  const Vec3 away = state_.pose.position - start_.position;
  if (away.norm() > motion_.reach) {
    state_.pose.position = start_.position + motion_.reach * away.normalized();
    state_.twist.head<3>() = -state_.twist.head<3>();
  }
}

void WildHand::teleport() {
  state_.pose.position = start_.position + uniform(random_, 0, motion_.reach) * direction(random_);
  state_.pose.rotation = expRotation(uniform(random_, 0, 3) * direction(random_)) * start_.rotation;
}

StressBout rideOf(const Pose& start, const StressMotion& motion, std::uint64_t seed) {
  StressBout out;
  RidingHand hand(start, motion, seed);
  const int riding = stepsIn(motion.ride, motion.step);
  for (int n = 0; n < riding; ++n) out.way.push_back(hand.ride());
  do {
    out.way.push_back(hand.goHome());
  } while (!hand.home());
  out.calm = stepsIn(motion.home, motion.step);
  out.way.insert(out.way.end(), out.calm, {start, Vec6::Zero()});
  return out;
}

}  // namespace palpate
