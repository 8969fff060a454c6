#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "palpate/haptics/device_state.h"
#include "palpate/math/types.h"

namespace palpate {

// The measures of the fidelity study; docs/fidelity.md defines them. Traces have one wrench *on the device* a tick
// [N; N m], at i * dt; all traces of a comparison have the same number of ticks.

using WrenchTrace = std::vector<Vec6>;
using MotionTrace = std::vector<DeviceState>;

/// Ticks [first, last).
struct TickRange {
  std::size_t first = 0, last = 0;
};

/// How far a trace is from the reference, over the whole run.
struct TraceError {
  double rms_force = 0;                 ///< root mean square of |F - F_ref| [N]
  double peak_force = 0;                ///< largest of it [N]
  double rms_torque = 0;                ///< the same of torque [N m]
  double peak_torque = 0;               ///< [N m]
  Vec3 peak_force_axes = Vec3::Zero();  ///< largest of each component of F - F_ref, force, along the world's axes [N]
};
TraceError traceError(const WrenchTrace& trace, const WrenchTrace& reference);

/// Largest size of the force [N].
double peakForce(const WrenchTrace& trace);

/// Settled parts of the stretches on which the device moves through free air at constant velocity: at least 0.3 s
/// without contact, faster than 5 mm/s, linear velocity constant to 1e-6 of itself; their first 0.15 s are left out.
/// @param touching  per tick: a contact of the reference carries force
std::vector<TickRange> settledFreeSegments(const MotionTrace& motion, const std::vector<char>& touching, double dt);

/// Mean of the force along the direction of motion, minus the reference's, over all ticks of the segments [N]; negative
/// where the method resists the motion. None without segments.
std::optional<double> drag(const WrenchTrace& trace, const WrenchTrace& reference, const MotionTrace& motion,
                           const std::vector<TickRange>& segments);

/// Tick at which contact first begins after none; none if that never happens.
std::optional<std::size_t> contactOnset(const std::vector<char>& touching);

/// Time after `tick` at which the force has first changed by more than `threshold` [s]; none if it never does.
std::optional<double> forceRise(const WrenchTrace& trace, std::size_t tick, double threshold, double dt);

constexpr double kFreeAfterRelease = 0.3;  ///< [s]
/// Tick at which the last contact ends, if nothing touches for kFreeAfterRelease after it; none otherwise.
std::optional<std::size_t> contactRelease(const std::vector<char>& touching, double dt);

/// Force once what came with the contact has faded: kFreeAfterRelease after the end of contact at `tick` [N].
Vec3 freeForce(const WrenchTrace& trace, std::size_t tick, double dt);

/// Time after `tick` until the force stays within `threshold` of `free` for the rest of kFreeAfterRelease [s]; negative
/// where it already did before, back to as long before; none if it never does.
std::optional<double> forceRelease(const WrenchTrace& trace, std::size_t tick, const Vec3& free, double threshold,
                                   double dt);

/// Impulse of the force error in the 0.2 s after `tick` [N s].
double glue(const WrenchTrace& trace, const WrenchTrace& reference, std::size_t tick, double dt);

/// Largest step of the force at a tick with a new model, beyond the reference's step there [N].
/// @param switched  per tick: a new model came into use
double switchStep(const WrenchTrace& trace, const WrenchTrace& reference, const std::vector<char>& switched);

/// Work of the wrench, held during each tick, on the hand [J]; positive: energy went to the hand.
double returnedEnergy(const WrenchTrace& trace, const MotionTrace& motion);

/// Wrenches known at k * step, linearly in between, at the ticks i * dt.
/// @param samples  not empty; the last one holds beyond its time
WrenchTrace interpolateSamples(const WrenchTrace& samples, double step, std::size_t ticks, double dt);

}  // namespace palpate
