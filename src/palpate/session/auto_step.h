#pragma once

#include <functional>
#include <vector>

namespace palpate {

struct SceneConfig;

/// A visual step chosen by what steps cost on this machine.
struct AutoStep {
  double step = 0;    ///< [s]
  double cost_s = 0;  ///< that 99 % of the warm-up's steps do not exceed, at the chosen step or the longest one
  bool holds = true;  ///< cost within kAutoShare of the step; false: not even the longest step does
};

/// Share of a visual step that it may cost: the rest is for what the warm-up has not seen.
inline constexpr double kAutoShare = 0.5;

/// Steps that are tried: whole ticks, each about a quarter longer than the one before, up to `longest` [s].
std::vector<double> autoSteps(double haptic_step, double longest);

/// The shortest of autoSteps() up to the scene's own step that the machine holds. The scene's motion is run in virtual
/// time at its own step, then at shorter ones from the shortest that the costs so far allow; each run ends with the
/// motion or after `patience` of computing. The choice is a number like any other: a run with it given is the same.
/// @param stopped  asked all the time
/// @throws RunError if a first visual step fails
AutoStep chooseVisualStep(
    const SceneConfig& config, double patience = 2.0, const std::function<bool()>& stopped = [] { return false; });

}  // namespace palpate
