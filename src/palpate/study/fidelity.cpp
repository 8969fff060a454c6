#include "palpate/study/fidelity.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "palpate/math/rotation.h"

namespace palpate {
namespace {

constexpr double kShortestSegment = 0.3;     // [s]
constexpr double kSettlingTime = 0.15;       // [s]
constexpr double kLeastSpeed = 0.005;        // [m/s]
constexpr double kVelocityTolerance = 1e-6;  // relative

void requireSameLength(std::size_t a, std::size_t b) {
  if (a != b) throw std::logic_error("traces of a comparison differ in length");
}

std::size_t ticksIn(double time, double dt) { return static_cast<std::size_t>(std::llround(time / dt)); }

}  // namespace

TraceError traceError(const WrenchTrace& trace, const WrenchTrace& reference) {
  requireSameLength(trace.size(), reference.size());
  TraceError out;
  double force_squares = 0, torque_squares = 0;
  for (std::size_t i = 0; i < trace.size(); ++i) {
    const double force = (trace[i] - reference[i]).head<3>().norm();
    const double torque = (trace[i] - reference[i]).tail<3>().norm();
    force_squares += force * force;
    torque_squares += torque * torque;
    out.peak_force = std::max(out.peak_force, force);
    out.peak_torque = std::max(out.peak_torque, torque);
  }
  const auto n = static_cast<double>(std::max<std::size_t>(trace.size(), 1));
  out.rms_force = std::sqrt(force_squares / n);
  out.rms_torque = std::sqrt(torque_squares / n);
  return out;
}

double peakForce(const WrenchTrace& trace) {
  double peak = 0;
  for (const Vec6& w : trace) peak = std::max(peak, w.head<3>().norm());
  return peak;
}

std::vector<TickRange> settledFreeSegments(const MotionTrace& motion, const std::vector<char>& touching, double dt) {
  requireSameLength(motion.size(), touching.size());
  std::vector<TickRange> out;
  const std::size_t shortest = ticksIn(kShortestSegment, dt);
  const std::size_t settling = ticksIn(kSettlingTime, dt);
  for (std::size_t first = 0; first < motion.size();) {
    const Vec3 velocity = motion[first].twist.head<3>();
    const double speed = velocity.norm();
    std::size_t last = first;
    while (last < motion.size() && speed > kLeastSpeed && !touching[last] &&
           (motion[last].twist.head<3>() - velocity).norm() <= kVelocityTolerance * speed) {
      ++last;
    }
    if (last > first && last - first >= std::max<std::size_t>(shortest, settling + 1)) {
      out.push_back({first + settling, last});
    }
    first = std::max(last, first + 1);
  }
  return out;
}

std::optional<double> drag(const WrenchTrace& trace, const WrenchTrace& reference, const MotionTrace& motion,
                           const std::vector<TickRange>& segments) {
  requireSameLength(trace.size(), reference.size());
  requireSameLength(trace.size(), motion.size());
  double sum = 0;
  std::size_t count = 0;
  for (const TickRange& segment : segments) {
    for (std::size_t i = segment.first; i < segment.last; ++i) {
      sum += (trace[i] - reference[i]).head<3>().dot(Vec3(motion[i].twist.head<3>()).normalized());
    }
    count += segment.last - segment.first;
  }
  if (count == 0) return std::nullopt;
  return sum / static_cast<double>(count);
}

std::optional<std::size_t> contactOnset(const std::vector<char>& touching) {
  for (std::size_t i = 1; i < touching.size(); ++i) {
    if (touching[i] && !touching[i - 1]) return i;
  }
  return std::nullopt;
}

std::optional<double> forceRise(const WrenchTrace& trace, std::size_t tick, double threshold, double dt) {
  for (std::size_t i = tick; i < trace.size(); ++i) {
    if ((trace[i] - trace[tick]).head<3>().norm() > threshold) return static_cast<double>(i - tick) * dt;
  }
  return std::nullopt;
}

double returnedEnergy(const WrenchTrace& trace, const MotionTrace& motion) {
  requireSameLength(trace.size(), motion.size());
  double energy = 0;
  for (std::size_t i = 0; i + 1 < trace.size(); ++i) {
    energy += trace[i].dot(poseDifference(motion[i + 1].pose, motion[i].pose));
  }
  return energy;
}

WrenchTrace interpolateSamples(const WrenchTrace& samples, double step, std::size_t ticks, double dt) {
  if (samples.empty()) throw std::logic_error("nothing to interpolate");
  WrenchTrace out;
  out.reserve(ticks);
  for (std::size_t i = 0; i < ticks; ++i) {
    const double place = static_cast<double>(i) * dt / step;
    const auto k = static_cast<std::size_t>(place + 1e-9);
    if (k + 1 >= samples.size()) {
      out.push_back(samples.back());
      continue;
    }
    const double share = std::max(place - static_cast<double>(k), 0.0);
    out.push_back((1.0 - share) * samples[k] + share * samples[k + 1]);
  }
  return out;
}

}  // namespace palpate
