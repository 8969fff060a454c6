#include <algorithm>
#include <limits>

#include "palpate/common/error.h"
#include "palpate/simulation/world.h"

namespace palpate {
namespace {

constexpr int kMaxSteps = 3000;
constexpr double kTolerance = 1e-12;  // displacement of a step, relative to the bodies' mean edge
// in contact the solver's tolerance, times so long a step, is a floor that displacements do not fall below
constexpr double kContactFloor = 1e-6;
constexpr int kPatience = 5;                                                   // steps without a smaller displacement
constexpr double kFirstStep = 0.02, kShortestStep = 1e-3, kLongestStep = 2.0;  // [s]
// nobody holds a free body: its rigid motions meet only its mass, which a long step makes small beside h^2 K
constexpr double kLongestFreeStep = 0.05;  // [s]

/// Lengths of settling steps, by the displacements that they lead to, which are relative to the mean edge.
class StepLength {
 public:
  explicit StepLength(double longest) : longest_(longest) {}
  double value() const { return h_; }
  /// Takes the displacement of a step of this length. @returns whether the bodies stand still
  bool settled(double displacement) {
    stale_ = displacement < best_ ? 0 : stale_ + 1;
    best_ = std::min(best_, displacement);
    const bool floor_reached = displacement < kContactFloor && stale_ >= kPatience;
    if (h_ >= longest_ && (displacement < kTolerance || floor_reached)) return true;
    // a jump of the displacement says that the step was too long for the nonlinearity
    const bool jumped = !first_ && displacement > 4.0 * previous_ && displacement > 1e-3;
    h_ = displacement > 0.3 || jumped ? std::max(0.5 * h_, kShortestStep) : std::min(1.3 * h_, longest_);
    previous_ = displacement;
    first_ = false;
    return false;
  }

 private:
  double longest_, h_ = kFirstStep;
  double previous_ = 0, best_ = std::numeric_limits<double>::infinity();
  int stale_ = 0;
  bool first_ = true;
};

}  // namespace

// Backward Euler with growing steps from rest is a damped Newton iteration on the static problem.
double World::settle(const std::vector<int>& moving, const Pose& device) {
  double longest = kLongestStep, edge = std::numeric_limits<double>::infinity();
  std::string names;
  for (const int i : moving) {
    if (!models_[i]->held()) longest = kLongestFreeStep;
    edge = std::min(edge, models_[i]->contactFinder().edgeLength());
    names += (names.empty() ? "" : ", ") + models_[i]->name();
  }
  StepLength h(longest);
  double speed = 0;
  double displacement = 0;
  bool settled = false;
  for (int n = 0; n < kMaxSteps && !settled; ++n) {
    for (const int i : moving) state_.bodies[i].clearVelocities();
    if (stepBodies(moving, {h.value(), gravity, link, {device, Vec6::Zero()}}, Advance::yes).failed()) {
      throw RunError(names + ": no static equilibrium: the system is not positive definite or not finite");
    }
    speed = largestSpeed(moving);
    displacement = speed * h.value() / edge;
    settled = h.settled(displacement);
  }
  if (!settled && displacement > 1e-6) {
    throw RunError(names + ": no static equilibrium at the start within " + std::to_string(kMaxSteps) +
                   " steps: does anything hold it?");
  }
  for (const int i : moving) state_.bodies[i].clearVelocities();
  return speed;
}

}  // namespace palpate
