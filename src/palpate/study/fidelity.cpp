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
    out.peak_force_axes = out.peak_force_axes.cwiseMax((trace[i] - reference[i]).head<3>().cwiseAbs());
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

namespace {

constexpr double kGlue = 0.2;  // [s]

}  // namespace

std::optional<std::size_t> contactRelease(const std::vector<char>& touching, double dt) {
  const std::size_t free = ticksIn(kFreeAfterRelease, dt);
  for (std::size_t i = touching.size(); i-- > 0;) {
    if (!touching[i]) continue;
    if (i + 1 + free >= touching.size()) return std::nullopt;
    return i + 1;
  }
  return std::nullopt;
}

Vec3 freeForce(const WrenchTrace& trace, std::size_t tick, double dt) {
  return trace[tick + ticksIn(kFreeAfterRelease, dt)].head<3>();
}

std::optional<double> forceRelease(const WrenchTrace& trace, std::size_t tick, const Vec3& free, double threshold,
                                   double dt) {
  const std::size_t around = ticksIn(kFreeAfterRelease, dt), first = tick > around ? tick - around : 0;
  std::size_t i = std::min(tick + around, trace.size());
  const std::size_t end = i;
  while (i > first && (trace[i - 1].head<3>() - free).norm() <= threshold) --i;
  if (i == end || i == first) return std::nullopt;
  return (static_cast<double>(i) - static_cast<double>(tick)) * dt;
}

double glue(const WrenchTrace& trace, const WrenchTrace& reference, std::size_t tick, double dt) {
  requireSameLength(trace.size(), reference.size());
  double sum = 0;
  for (std::size_t i = tick; i < std::min(tick + ticksIn(kGlue, dt), trace.size()); ++i) {
    sum += (trace[i] - reference[i]).head<3>().norm() * dt;
  }
  return sum;
}

double switchStep(const WrenchTrace& trace, const WrenchTrace& reference, const std::vector<char>& switched) {
  requireSameLength(trace.size(), reference.size());
  requireSameLength(trace.size(), switched.size());
  double largest = 0;
  for (std::size_t i = 1; i < trace.size(); ++i) {
    if (!switched[i]) continue;
    const double own = (trace[i] - trace[i - 1]).head<3>().norm();
    largest = std::max(largest, own - (reference[i] - reference[i - 1]).head<3>().norm());
  }
  return largest;
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
