#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "palpate/one_d/model.h"

namespace palpate::one_d {

/// How the force on the device is made: virtual coupling to the visual handle, the paper's handle-space linearization
/// between proxy and tool, or the live model of the tool in the tick.
enum class Method { kVc, kHsl, kLive };

/// "vc", "hsl" or "live".
std::string methodName(Method method);

/// The whole experiment; the members' initial values are its defaults.
struct Config {
  Parameters parameters;
  std::vector<Knot> trajectory{{0.0, 0.45}, {1.0, 0.05}, {1.4, 0.05}, {2.4, 0.45}, {2.6, 0.45}};
  double haptic_dt = 0.001;                                  ///< [s]
  std::vector<double> visual_dts{0.001, 0.005, 0.01, 0.02};  ///< [s]; each a whole multiple of haptic_dt
  double latency = 1.0;  ///< visual steps between the start of a step and the use of its result
  std::vector<Method> methods{Method::kVc, Method::kHsl, Method::kLive};

  /// The reference: virtual coupling at this visual step, without latency [s].
  static constexpr double kReferenceDt = 0.001;
};

/// Reads a configuration (YAML, see docs/one-d.md); what the file leaves out keeps its default.
/// @throws InputError for a missing or unreadable file, malformed YAML, unknown keys, wrong types, values out of range.
Config readConfig(const std::string& file);

/// The same from text; `name` stands for the file in messages.
Config parseConfig(const std::string& text, const std::string& name);

/// How many times `part` goes into `whole` [both s]; 0 unless that is a whole number, up to rounding in the input.
long long wholeMultiple(double whole, double part);

/// Of a visual loop [ticks].
struct Timing {
  std::size_t period;  ///< between the starts of two steps
  std::size_t delay;   ///< from the start of a step to the use of its result, rounded up
};
Timing timingOf(const Config& config, double visual_dt, double latency);

/// Handle and tool at rest where the trajectory begins.
ToolState restAtStart(const Config& config);

}  // namespace palpate::one_d
