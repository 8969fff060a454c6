#include "palpate/simulation/world.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "palpate/common/error.h"
#include "palpate/common/parallel.h"

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

int World::add(Body body, bool self_contact) {
  bodies_.push_back(std::make_unique<Body>(std::move(body)));
  const int index = bodies() - 1;
  const Body& added = *bodies_.back();
  if (tool_ < 0 && added.held()) tool_ = index;
  friction_.setBody(index, added.friction());
  surfaces_.addBody(index, added.mesh(), self_contact && !added.isRigid());
  return index;
}

int World::toolRows() const {
  const std::vector<int>& moved = contacts().bodies;
  const auto at = std::find(moved.begin(), moved.end(), tool_);
  return at == moved.end() ? -1 : static_cast<int>(at - moved.begin());
}

// Obstacles are complete once the first step comes.
void World::prepare() {
  if (prepared_) return;
  prepared_ = true;
  for (std::size_t i = 0; i < obstacles.size(); ++i) {
    friction_.setObstacle(static_cast<int>(i), obstacles[i].friction);
    if (const std::optional<Surface> surface = surfaceOf(obstacles[i])) {
      surfaces_.addObstacle(static_cast<int>(i), *surface);
    }
  }
}

// Orders last what contact may touch: nodes that were near something in the last step, and those near planes where the
// present velocities lead. When some are missing, those a little farther away come too, so that the order then lasts.
void World::orderContactNodes(int index, double h, std::vector<int>& nearby) {
  Body& body = *bodies_[index];
  const double edge = body.contactFinder().edgeLength();
  const VecX x = body.positions() + h * body.velocities();
  nearby.clear();
  stage_.touchedNodes(index, body.nodes(), nearby);
  body.contactFinder().nearbyNodes(x, obstacles, 0.02 * edge, nearby);
  if (body.contactNodesFit(nearby)) return;
  body.contactFinder().nearbyNodes(x, obstacles, 0.08 * edge, nearby);
  body.orderContactNodes(nearby);
}

void World::beginBody(int i, const StepInput& input, Begin& begin) {
  Body& body = *bodies_[i];
  Stopwatch watch;
  begin.times = {};
  body.assemble(input);
  begin.times.assemble = watch.lap();
  orderContactNodes(i, input.step, begin.nearby);
  const bool factorized = body.factorize();
  begin.times.factorize = watch.lap();
  if (factorized) body.solveFree();
  begin.times.solve = watch.lap();
  begin.good = factorized && body.endVelocity().allFinite() && body.endTwist().allFinite();
}

void World::beginBodies(const std::vector<int>& moving, const StepInput& input, StepTimes& times) {
  begin_.resize(std::max(begin_.size(), moving.size()));
  moving_.clear();
  for (const int i : moving) moving_.push_back(bodies_[i].get());
  Stopwatch watch;
  forEachBody(moving_, [&](int k) { beginBody(moving[k], input, begin_[k]); });
  // what they took together, by what each kind of work took
  const double elapsed = watch.lap();
  StepTimes sum;
  for (std::size_t k = 0; k < moving.size(); ++k) {
    sum.assemble += begin_[k].times.assemble;
    sum.factorize += begin_[k].times.factorize;
    sum.solve += begin_[k].times.solve;
  }
  const double share = sum.total() > 0 ? elapsed / sum.total() : 0.0;
  times.assemble += share * sum.assemble;
  times.factorize += share * sum.factorize;
  times.solve += share * sum.solve;
}

void World::reportContacts(StepReport& report) const {
  const ContactSet& set = stage_.result();
  report.contacts_found = set.candidates;
  report.contacts = static_cast<int>(set.contacts.size());
  report.active = set.active();
  report.sticking = set.count(ContactState::stick);
  report.sliding = report.active - report.sticking;
  report.solver_iterations = set.solver.iterations;
  report.solver_residual = set.solver.residual;
  report.passes = set.passes;
  report.penetration = set.penetration;
  if (!set.solver.converged && report.status == StepStatus::ok) report.status = StepStatus::contact_not_converged;
}

// The paper's step 1: form A and b, factorize, move freely, body by body; then the contacts of all. Its steps 2 to 6
// are linearize(). A body whose system fails stands still at its last good state, and the others touch it there.
StepReport World::stepBodies(const std::vector<int>& moving, const StepInput& input, bool advance) {
  prepare();
  if (Executor* executor = Executor::current()) executor->wake();
  StepReport report;
  const auto fail = [&](Body& body) {
    body.clearVelocities();
    report.status = StepStatus::restored;
  };
  beginBodies(moving, input, report.times);
  moving_.clear();
  moving_indices_.clear();
  for (std::size_t k = 0; k < moving.size(); ++k) {
    if (begin_[k].good) {
      moving_.push_back(bodies_[moving[k]].get());
      moving_indices_.push_back(moving[k]);
    } else {
      fail(*bodies_[moving[k]]);
    }
  }
  Stopwatch watch;
  int restorations = 0;
  for (const auto& b : bodies_) restorations += b->restorations();
  if (restorations != restorations_) surfaces_.recheckOverlaps();
  restorations_ = restorations;
  if (surfaces_.active()) {
    for (int i = 0; i < bodies(); ++i) surfaces_.setStart(i, bodies_[i]->positions());
    surfaces_.examineOverlaps();
  }
  const ContactInput contacts{obstacles, surfaces_, friction_, contact};
  bool good = stage_.solve(moving_, moving_indices_, contacts);
  for (const Body* b : moving_) good = good && b->endVelocity().allFinite() && b->endTwist().allFinite();
  if (good) reportContacts(report);
  report.times.contact += watch.lap();
  if (good && advance) {
    stage_.limitMotion(moving_, moving_indices_, contacts, share_);
    report.penetration = stage_.result().penetration;
    report.times.contact += watch.lap();
    for (std::size_t b = 0; b < moving_.size(); ++b) {
      report.motion_share = std::min(report.motion_share, share_[b]);
      good = moving_[b]->advance(share_[b]) && good;
    }
  }
  if (!good) {
    for (Body* b : moving_) fail(*b);
    stage_.forget();
  }
  report.times.advance += watch.lap();
  return report;
}

LinkParameters World::saturatedLink(const DeviceTarget& device) const {
  LinkParameters out = link;
  if (!hasTool()) return out;
  const Handle& handle = tool().handle();
  const Vec6 wrench = linkWrenchOnDevice(link, handle.pose, handle.twist, device.pose, device.twist);
  const double force = std::min(1.0, link_force_limit / wrench.head<3>().norm());
  const double torque = std::min(1.0, link_torque_limit / wrench.tail<3>().norm());
  if (force < 1) {
    out.stiffness *= force;
    out.damping *= force;
  }
  if (torque < 1) {
    out.rotational_stiffness *= torque;
    out.rotational_damping *= torque;
  }
  return out;
}

StepReport World::stepAll(const DeviceTarget& device, double h, bool advance) {
  all_.resize(bodies_.size());
  std::iota(all_.begin(), all_.end(), 0);
  StepReport report = stepBodies(all_, {h, gravity, saturatedLink(device), device}, advance);
  Stopwatch watch;
  moving_.clear();
  for (const auto& body : bodies_) moving_.push_back(body.get());
  elastic_.resize(bodies_.size());
  forEachBody(moving_, [&](int b) { elastic_[b] = moving_[b]->elasticEnergy(); });
  for (int b = 0; b < bodies(); ++b) {
    report.kinetic_energy += bodies_[b]->kineticEnergy();
    report.elastic_energy += elastic_[b];
  }
  report.times.advance += watch.lap();
  return report;
}

StepReport World::step(const DeviceTarget& device, double h) { return stepAll(device, h, true); }

StepReport World::evaluate(const DeviceTarget& device, double h) { return stepAll(device, h, false); }

double World::settle(const std::vector<int>& moving, const Pose& device) {
  // Backward Euler with growing steps from rest is a damped Newton iteration on the static problem.
  constexpr int kMaxSteps = 3000;
  constexpr double kTolerance = 1e-12;  // displacement of a step, relative to the bodies' mean edge
  // in contact the solver's tolerance, times so long a step, is a floor that displacements do not fall below
  constexpr double kContactFloor = 1e-6;
  constexpr int kPatience = 5;  // steps without a smaller displacement
  // nobody holds a free body: its rigid motions meet only its mass, which a long step makes small beside h^2 K
  double longest_step = 2.0;
  double scale = std::numeric_limits<double>::infinity();
  std::string names;
  for (const int i : moving) {
    if (!bodies_[i]->held()) longest_step = 0.05;
    scale = std::min(scale, bodies_[i]->contactFinder().edgeLength());
    names += (names.empty() ? "" : ", ") + bodies_[i]->name();
  }
  double h = 0.02;
  double speed = 0;
  double previous = 0;
  double best = std::numeric_limits<double>::infinity();
  int stale = 0;
  for (int n = 0; n < kMaxSteps; ++n) {
    for (const int i : moving) bodies_[i]->clearVelocities();
    if (stepBodies(moving, {h, gravity, link, {device, Vec6::Zero()}}, true).status == StepStatus::restored) {
      throw RunError(names + ": no static equilibrium: the system is not positive definite or not finite");
    }
    speed = 0;
    for (const int i : moving) {
      const Body& b = *bodies_[i];
      if (b.endVelocity().size() > 0) speed = std::max(speed, b.endVelocity().cwiseAbs().maxCoeff());
      speed = std::max(speed, b.endTwist().cwiseAbs().maxCoeff());
    }
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
      throw RunError(names + ": no static equilibrium at the start within " + std::to_string(kMaxSteps) +
                     " steps: does anything hold it?");
    }
  }
  for (const int i : moving) bodies_[i]->clearVelocities();
  return speed;
}

}  // namespace palpate
