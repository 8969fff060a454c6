#pragma once

namespace palpate {

/// Where the time of a live model goes, wall clock [s].
struct ReductionTimes {
  double factorize = 0;  ///< elastic forces at the corrected places, and the factor, which the next step uses
  double modes = 0;      ///< of the tool, and its inertia
  double search = 0;     ///< for what it touches or soon may
  double partners = 0;   ///< what the touched bodies give way, and their modes: what is left when the search is done
  double replay = 0;     ///< of the model of the step before
};

}  // namespace palpate
