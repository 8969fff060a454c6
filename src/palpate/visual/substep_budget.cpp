#include "palpate/visual/substep_budget.h"

#include <algorithm>

namespace palpate {

void SubstepBudget::took(double seconds) {
  if (!adapts_) return;
  constexpr double kShare = 0.6;       // of the visual step; the rest is for what differs from step to step
  constexpr double kShortest = 0.001;  // [s]
  const double one = seconds / (substeps_ > 1 ? substeps_ + 1 : 1);
  const double fit = kShare * visual_step_ / one - 1.0;
  const int most = static_cast<int>(visual_step_ / kShortest + 1e-9);
  const int wanted = fit < 2 ? 1 : std::min(static_cast<int>(std::min(fit, 1e6)), most);
  // down at once, up by one at a time
  substeps_ = std::max(1, std::min(wanted, substeps_ + 1));
}

}  // namespace palpate
