#include "palpate/simulation/world.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "palpate/common/error.h"

namespace palpate {
namespace {

class Stopwatch {
 public:
  /// Seconds since construction or the last call.
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double> elapsed = now - last_;
    last_ = now;
    return elapsed.count();
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace

int World::add(Body body) {
  bodies_.push_back(std::make_unique<Body>(std::move(body)));
  stages_.push_back(std::make_unique<ContactStage>());
  const int index = bodies() - 1;
  if (tool_ < 0 && bodies_.back()->held()) tool_ = index;
  return index;
}

// Orders last what contact may touch: nodes near obstacles where the present velocities lead. When some are missing,
// those a little farther away come too, so that the order then lasts.
void World::orderContactNodes(Body& body, double h) const {
  const double edge = body.contactFinder().edgeLength();
  const VecX x = body.positions() + h * body.velocities();
  std::vector<int> nodes;
  body.contactFinder().nearbyNodes(x, obstacles, 0.02 * edge, nodes);
  if (body.contactNodesFit(nodes)) return;
  nodes.clear();
  body.contactFinder().nearbyNodes(x, obstacles, 0.08 * edge, nodes);
  body.orderContactNodes(nodes);
}

// The paper's step 1 for one body: form A and b, factorize, move freely, then contact. Its steps 2 to 6 are
// linearize().
bool World::stepBody(int i, const StepInput& input, StepReport& report) {
  Body& body = *bodies_[i];
  Stopwatch watch;
  body.assemble(input);
  report.times.assemble += watch.lap();
  orderContactNodes(body, input.step);
  if (!body.factorize()) return false;
  report.times.factorize += watch.lap();
  body.solveFree();
  report.times.solve += watch.lap();
  if (!stages_[i]->solve({&body}, {i}, obstacles, contact)) return false;
  report.times.contact += watch.lap();
  const ContactSet& set = stages_[i]->result();
  report.contacts_found += set.candidates;
  report.contacts += static_cast<int>(set.contacts.size());
  report.active += set.active();
  report.sticking += set.count(ContactState::stick);
  report.sliding += set.active() - set.count(ContactState::stick);
  report.solver_iterations += set.solver.iterations;
  report.solver_residual = std::max(report.solver_residual, set.solver.residual);
  report.passes = std::max(report.passes, set.passes);
  report.penetration = std::max(report.penetration, set.penetration);
  if (!set.solver.converged && report.status == StepStatus::ok) report.status = StepStatus::contact_not_converged;
  return body.endVelocity().allFinite() && body.endTwist().allFinite();
}

StepReport World::stepAll(const DeviceTarget& device, double h, bool advance) {
  StepReport report;
  const StepInput input{h, gravity, link, device};
  for (int i = 0; i < bodies(); ++i) {
    const bool good = stepBody(i, input, report);
    Stopwatch watch;
    if (!good || (advance && !bodies_[i]->advance())) {
      bodies_[i]->clearVelocities();
      stages_[i]->forget();
      report.status = StepStatus::restored;
    }
    report.times.advance += watch.lap();
  }
  Stopwatch watch;
  for (const auto& body : bodies_) {
    report.kinetic_energy += body->kineticEnergy();
    report.elastic_energy += body->elasticEnergy();
  }
  report.times.advance += watch.lap();
  return report;
}

StepReport World::step(const DeviceTarget& device, double h) { return stepAll(device, h, true); }

StepReport World::evaluate(const DeviceTarget& device, double h) { return stepAll(device, h, false); }

double World::settle(int index, const Pose& device) {
  // Backward Euler with growing steps from rest is a damped Newton iteration on the static problem.
  constexpr int kMaxSteps = 3000;
  // nobody holds a free body: its rigid motions meet only its mass, which a long step makes small beside h^2 K
  const double longest_step = bodies_[index]->held() ? 2.0 : 0.05;
  constexpr double kTolerance = 1e-12;  // displacement of a step, relative to the body's mean edge
  // in contact the solver's tolerance, times so long a step, is a floor that displacements do not fall below
  constexpr double kContactFloor = 1e-6;
  constexpr int kPatience = 5;  // steps without a smaller displacement
  Body& body = *bodies_[index];
  const double scale = body.contactFinder().edgeLength();
  double h = 0.02;
  double speed = 0;
  double previous = 0;
  double best = std::numeric_limits<double>::infinity();
  int stale = 0;
  StepReport report;
  for (int n = 0; n < kMaxSteps; ++n) {
    body.clearVelocities();
    if (!stepBody(index, {h, gravity, link, {device, Vec6::Zero()}}, report)) {
      throw RunError(body.name() + ": no static equilibrium: the system is not positive definite");
    }
    speed = std::max(body.endVelocity().size() > 0 ? body.endVelocity().cwiseAbs().maxCoeff() : 0.0,
                     body.endTwist().cwiseAbs().maxCoeff());
    if (!body.advance()) throw RunError(body.name() + ": no static equilibrium: the state is not finite");
    const double displacement = speed * h / scale;
    stale = displacement < best ? 0 : stale + 1;
    best = std::min(best, displacement);
    const bool floor_reached = displacement < kContactFloor && stale >= kPatience;
    if (h >= longest_step && (displacement < kTolerance || floor_reached)) break;
    // a jump of the displacement says that the step was too long for the nonlinearity
    h = displacement > 0.3 || (n > 0 && displacement > 4.0 * previous && displacement > 1e-3)
            ? std::max(0.5 * h, 1e-3)
            : std::min(1.3 * h, longest_step);
    previous = displacement;
    if (n + 1 == kMaxSteps && displacement > 1e-6) {
      throw RunError(body.name() + ": finds no static equilibrium at its pose in " + std::to_string(kMaxSteps) +
                     " steps: does anything hold it?");
    }
  }
  body.clearVelocities();
  return speed;
}

}  // namespace palpate
