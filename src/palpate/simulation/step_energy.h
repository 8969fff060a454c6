#pragma once

#include "palpate/simulation/body_system.h"

namespace palpate {

/// Work that link and gravity did on bodies [J].
struct StepWork {
  double sum = 0;
  double magnitudes = 0;
  void add(double work) {
    sum += work;
    magnitudes += std::abs(work);
  }
  StepWork& operator+=(const StepWork& other) {
    sum += other.sum;
    magnitudes += other.magnitudes;
    return *this;
  }
};

/// Work on one body in a step that was just taken. The link's is that of its wrench at the end, along the handle's
/// motion: an implicit step may lose energy against it, and should not gain any.
/// @param system  of the step
/// @param end     state at its end
StepWork workOn(const BodySystem& system, const BodyState& end);

/// Energy that a step made: what it ends with beyond what it began with, the work and a hundredth of the sum of their
/// magnitudes [J]; 0 where that is less than rounding.
/// @param share  of a whole step: a part may make as much less
double energyMade(double start, double end, const StepWork& work, double share = 1.0);

}  // namespace palpate
