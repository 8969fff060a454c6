#pragma once

namespace palpate {

/// Wall-clock parts of a visual step [s].
struct StepTimes {
  double assemble = 0;   ///< element rotations, forces, matrices
  double factorize = 0;  ///< ordering where renewed, numeric factorization
  double solve = 0;      ///< free motion, handle's Schur complement
  double contact = 0;    ///< finding, reducing, Delassus operator, contact solver, passes
  double advance = 0;
  double total() const { return assemble + factorize + solve + contact + advance; }
  StepTimes& operator+=(const StepTimes& other) {
    assemble += other.assemble;
    factorize += other.factorize;
    solve += other.solve;
    contact += other.contact;
    advance += other.advance;
    return *this;
  }
};

enum class StepStatus {
  ok,
  contact_not_converged,  ///< the step counts; the residual says how far off it is
  restored,               ///< the step failed (not positive definite, not finite): last good state, at rest
};

/// What one step did.
struct StepReport {
  StepStatus status = StepStatus::ok;
  StepTimes times;
  int contacts_found = 0;  ///< surface vertices within reach, before reduction
  int contacts = 0;        ///< after reduction
  int active = 0, sticking = 0, sliding = 0;
  int solver_iterations = 0;
  double solver_residual = 0;  ///< [m/s]
  bool converged = true;       ///< to the solver's tolerance; status `ok` asks for what will do in a step
  int passes = 0;
  double penetration = 0;   ///< deepest surface point in another solid at the end of the step [m]
  double motion_share = 1;  ///< least share of a body's motion that was made; what would have crossed was held back
  int parts = 0;            ///< in which it was taken
  int redone = 0;  ///< shorter steps in which it was done again, as in one it would not converge or cross; 0: none
  double kinetic_energy = 0, elastic_energy = 0;  ///< [J], at the end
  /// By which the energy at the end exceeds that at the start, the work of link, gravity and driven bodies, and a
  /// hundredth of the sum of all their magnitudes [J].
  double energy_made = 0;
  /// That corrections with a followed path brought; below zero where they were to take some away, which contact need
  /// not let happen [J]. Of each part, what is above zero is not counted as made.
  double energy_corrected = 0;
  double corrected_share = 0;  ///< of these, brought in as far as contact let them: while the path was followed
  bool out_of_budget = false;  ///< the budget was used up: the rest of the step was taken as it came
  bool failed() const { return status == StepStatus::restored; }
  /// It went to its end, with contact as it should be.
  bool sound() const { return status == StepStatus::ok && motion_share >= 1.0 && !out_of_budget; }
  /// Takes over the next part of the same step: its end, the worse of both, the times of both.
  void append(const StepReport& part);
};

}  // namespace palpate
