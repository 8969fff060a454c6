#include "palpate/simulation/step_report.h"

#include <algorithm>

namespace palpate {

void StepReport::append(const StepReport& part) {
  StepReport sum = part;
  sum.status = std::max(status, part.status);
  sum.times += times;
  sum.solver_iterations += solver_iterations;
  sum.solver_residual = std::max(solver_residual, part.solver_residual);
  sum.converged = converged && part.converged;
  sum.passes = std::max(passes, part.passes);
  sum.motion_share = std::min(motion_share, part.motion_share);
  sum.parts += parts;
  sum.redone += redone;
  sum.energy_corrected += energy_corrected;
  sum.corrected_share += corrected_share;
  sum.out_of_budget = out_of_budget || part.out_of_budget;
  *this = sum;
}

}  // namespace palpate
