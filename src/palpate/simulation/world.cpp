#include "palpate/simulation/world.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "palpate/common/error.h"
#include "palpate/common/parallel.h"
#include "palpate/common/scoped_timer.h"

namespace palpate {

int World::add(BodyModel model, bool self_contact) {
  models_.push_back(std::make_unique<BodyModel>(std::move(model)));
  const BodyModel& added = *models_.back();
  const int index = bodies() - 1;
  if (tool_ < 0 && added.held()) tool_ = index;
  friction_.setBody(index, added.friction());
  surfaces_.addBody(index, added.mesh(), self_contact && !added.isRigid());
  systems_.push_back(std::make_unique<BodySystem>(added));
  state_.bodies.push_back(added.startState());
  state_.surfaces = surfaces_.state();
  return index;
}

std::vector<const BodyModel*> World::models() const {
  std::vector<const BodyModel*> out;
  for (const auto& model : models_) out.push_back(model.get());
  return out;
}

bool World::glue(int body, int attachment, int partner) {
  constexpr double kAround = 0.5;  // mean edges
  joints_.push_back(joinBodies(models(), body, attachment, partner));
  refuseCircles(models(), joints_);
  const BodyModel& own = *models_[body];
  return surfaces_.leaveOut(body, surfaceAround(own, own.attachments()[attachment]), partner,
                            kAround * own.contactFinder().edgeLength());
}

std::vector<int> World::gluedTogether(int body) const {
  std::vector<char> in(models_.size(), 0);
  in[body] = 1;
  const auto stands = [&](int i) { return models_[i]->isRigid() && !models_[i]->held(); };
  for (bool grown = true; grown;) {
    grown = false;
    for (const Joint& joint : joints_) {
      if (in[joint.body] == in[joint.partner] || stands(joint.body) || stands(joint.partner)) continue;
      in[joint.body] = in[joint.partner] = 1;
      grown = true;
    }
  }
  std::vector<int> out;
  for (int i = 0; i < bodies(); ++i) {
    if (in[i] != 0) out.push_back(i);
  }
  return out;
}

std::vector<Contact> World::glued(int body) const {
  std::vector<Contact> out;
  if (joints_.empty()) return out;
  glueContacts(models(), joints_, state_.bodies, std::vector<char>(models_.size(), 1), out);
  std::erase_if(out, [&](const Contact& c) { return c.first.body != body && c.second.body != body; });
  return out;
}

const BodyContactRows* World::bodyRows(int body) const {
  const std::vector<int>& moved = contacts().bodies;
  const auto at = std::find(moved.begin(), moved.end(), body);
  return at == moved.end() ? nullptr : &contacts().rows[static_cast<std::size_t>(at - moved.begin())];
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
  state_.surfaces = surfaces_.state();
}

void World::requireFit(int i, const BodyState& state) const {
  const BodyModel& model = *models_[i];
  const auto size = static_cast<Eigen::Index>(3 * model.nodes());
  const auto known = [&](int n) { return n >= 0 && n < model.nodes() && model.row()[n] >= 0; };
  const std::vector<int>& last = state.order.last_nodes;
  const std::vector<int>& released = state.elastic.released;
  const int elements = static_cast<int>(model.elasticity().elements().size());
  const bool ordered = std::is_sorted(released.begin(), released.end()) &&
                       (released.empty() || (released.front() >= 0 && released.back() < elements));
  if (!ordered || state.positions.size() != size || state.velocities.size() != size ||
      state.elastic.rotations.size() != model.elasticity().elements().size() || !(state.elastic.stiffness_scale > 0) ||
      !std::all_of(last.begin(), last.end(), known) || state.order.sought < 0 ||
      state.order.sought > static_cast<int>(last.size())) {
    throw InputError("state", model.name(), "is not a state of this body");
  }
}

void World::restore(const WorldState& state) {
  prepare();
  if (state.bodies.size() != state_.bodies.size() ||
      state.surfaces.may_overlap.size() != state_.surfaces.may_overlap.size() ||
      state.surfaces.tangled.size() != state_.surfaces.tangled.size()) {
    throw InputError("state", "bodies", "are not those of this world");
  }
  for (int i = 0; i < bodies(); ++i) requireFit(i, state.bodies[i]);
  state_ = state;
  energy_known_ = false;
  surfaces_.restore(state.surfaces);
  friction_.setScale(state.friction_scale);
  for (const auto& system : systems_) system->forget();
}

// Positions or material were changed from outside.
void World::wasSet(int i) {
  energy_known_ = false;
  systems_[i]->forget();
}

void World::setBody(int i, const BodyState& state) {
  requireFit(i, state);
  state_.bodies[i] = state;
  wasSet(i);
  surfaces_.recheckOverlaps();
}

void World::setHandle(int i, const HandleState& handle) {
  models_[i]->setHandle(handle, state_.bodies[i]);
  wasSet(i);
  surfaces_.recheckOverlaps();
}

void World::setStiffnessScale(int i, double scale) {
  if (!(scale > 0) || !std::isfinite(scale)) throw InputError("stiffness scale", "", "must be positive and finite");
  state_.bodies[i].elastic.stiffness_scale = scale;
  wasSet(i);
}

void World::setFrictionScale(double scale) {
  state_.friction_scale = scale;
  friction_.setScale(scale);
}

std::vector<int> World::all() const {
  std::vector<int> out(models_.size());
  std::iota(out.begin(), out.end(), 0);
  return out;
}

// A body whose system fails stands still at its last good state, and the others touch it there.
void World::fail(int i, StepReport& report) {
  state_.bodies[i].clearVelocities();
  report.status = StepStatus::restored;
}

// Orders last what contact may touch: nodes that were near something in the last step, and those near planes where the
// present velocities lead. When some are missing, those a little farther away come too, so that the order then lasts.
void World::orderContactNodes(int i, double h, std::vector<int>& nearby) {
  BodySystem& body = *systems_[i];
  const ContactFinder& finder = models_[i]->contactFinder();
  const double edge = finder.edgeLength();
  const VecX x = state_.bodies[i].positions + h * state_.bodies[i].velocities;
  nearby.clear();
  state_.contacts.touchedNodes(i, models_[i]->nodes(), nearby);
  finder.nearbyNodes(x, obstacles, 0.02 * edge, nearby);
  const OrderFit fit = body.contactNodesFit(nearby);
  if (fit == OrderFit::good) return;
  finder.nearbyNodes(x, obstacles, 0.08 * edge, nearby);
  if (fit == OrderFit::lacks) {
    body.addContactNodes(nearby);
  } else {
    body.orderContactNodes(nearby);
  }
}

// A and b of one body, their factor, and its motion without contact.
void World::beginBody(int i, const StepInput& input, BodyBegin& begin) {
  BodySystem& body = *systems_[i];
  begin.times = {};
  {
    const ScopedTimer timer(begin.times.assemble);
    body.assemble(input, state_.bodies[i], correctionOf(input.followed.others, i));
  }
  {
    const ScopedTimer timer(begin.times.factorize);
    orderContactNodes(i, input.step, begin.nearby);
    begin.good = body.factorize();
  }
  const ScopedTimer timer(begin.times.solve);
  if (begin.good) body.solveFree();
  begin.good = begin.good && body.endIsFinite();
}

// The same for all, those that could into moving_. Times are what they took together, shared out by kind of work.
bool World::beginBodies(const std::vector<int>& moving, const StepInput& input, Ending ending, StepReport& report) {
  begin_.resize(std::max(begin_.size(), moving.size()));
  moving_.clear();
  for (const int i : moving) moving_.add(i, *systems_[i]);
  double elapsed = 0;
  {
    const ScopedTimer timer(elapsed);
    moving_.forEach([&](int k) { beginBody(moving[k], input, begin_[k]); });
  }
  StepTimes sum;
  bool good = true;
  moving_.clear();
  for (std::size_t k = 0; k < moving.size(); ++k) {
    sum += begin_[k].times;
    meter_.spend(systems_[moving[k]]->factorOperations());
    good = good && begin_[k].good;
    if (begin_[k].good) {
      moving_.add(moving[k], *systems_[moving[k]]);
    } else if (ending != Ending::free) {
      fail(moving[k], report);
    }
  }
  const double share = sum.total() > 0 ? elapsed / sum.total() : 0.0;
  report.times.assemble += share * sum.assemble;
  report.times.factorize += share * sum.factorize;
  report.times.solve += share * sum.solve;
  return good;
}

// Equalities of the bodies in moving_ that are glued.
void World::findGlue() {
  glued_.clear();
  if (joints_.empty()) return;
  std::vector<char> moves(models_.size(), 0);
  for (const int i : moving_.indices()) moves[i] = 1;
  glueContacts(models(), joints_, state_.bodies, moves, glued_);
}

// Contact impulses of the bodies in moving_, and their end velocities.
bool World::solveContacts(double share, StepReport& report) {
  const ScopedTimer timer(report.times.contact);
  if (surfaces_.active()) {
    for (int i = 0; i < bodies(); ++i) surfaces_.setStart(i, state_.bodies[i].positions);
    surfaces_.examineOverlaps(state_.halvings > bent_);
  }
  findGlue();
  bool good =
      stage_.solve(moving_, {obstacles, surfaces_, friction_, contact, meter_, share, &glued_}, state_.contacts);
  for (int k = 0; k < moving_.size(); ++k) good = good && moving_[k].endIsFinite();
  if (good) reportContacts(report);
  return good;
}

// The bodies in moving_ to the end of the step.
bool World::advance(StepReport& report) {
  {
    const ScopedTimer timer(report.times.contact);
    report.motion_share = stage_.limitMotion(moving_, {obstacles, surfaces_, friction_, contact, meter_});
    report.penetration = stage_.result().penetration;
  }
  const ScopedTimer timer(report.times.advance);
  bool good = true;
  for (int k = 0; k < moving_.size(); ++k) good = moving_[k].advance() && good;
  return good;
}

void World::reportContacts(StepReport& report) const {
  const ContactSet& set = stage_.result();
  report.contacts_found = set.candidates;
  report.contacts = static_cast<int>(set.contacts.size()) - set.glued;
  report.active = set.active();
  report.sticking = set.count(ContactState::stick);
  report.sliding = report.active - report.sticking;
  report.solver_iterations = set.solver.iterations;
  report.solver_residual = set.solver.residual;
  report.converged = set.solver.to_tolerance;
  report.passes = set.passes;
  report.penetration = set.penetration;
  if (!set.solver.converged && report.status == StepStatus::ok) report.status = StepStatus::contact_not_converged;
}

// A v = b + J^T lambda,  J v >= b_lambda,  complementarity and friction (paper, eq. 2): the bodies' systems and free
// motion first, then the contacts of all, then the motion.
StepReport World::stepBodies(const std::vector<int>& moving, const StepInput& input, Ending ending, double share) {
  prepare();
  if (Executor* executor = Executor::current()) executor->wake();
  StepReport report;
  const bool begun = beginBodies(moving, input, ending, report);
  const bool all_or_none = ending == Ending::free;
  bool good = (begun || !all_or_none) && solveContacts(share, report);
  if (all_or_none)
    good = good && report.status == StepStatus::ok && !stage_.result().crossing && !stage_.result().given_up &&
           !stage_.result().resisted;
  if (good && ending != Ending::stay) good = advance(report);
  if (!good && all_or_none) {
    report.status = StepStatus::restored;
  } else if (!good) {
    for (int k = 0; k < moving_.size(); ++k) fail(moving_.index(k), report);
    state_.contacts.clear();
  }
  state_.surfaces = surfaces_.state();
  return report;
}

constexpr int kShortest = 16;        // as a part of a step
constexpr int kMostPulled = 15;      // steps after a path was left, before one is tried again
constexpr int kGoodParts = 4;        // so many good parts before a longer one is tried
constexpr double kTryShare = 0.16;   // of the budget: what a try may cost that need not succeed
constexpr double kDearShare = 0.2;   // of the budget: who has used that up cannot afford many more tries that fail
constexpr double kLeastTime = 0.5;   // of what the last part took: with less by the clock the next one is not begun
constexpr double kPartCost = 2.0;    // of a part that is good, for its factorization's
constexpr int kMostBent = 3;         // halvings of a step that bends
constexpr double kBentShare = 0.25;  // of its length: what its parts may then take together, by what one took last
// an end that has more energy than work explains, by this much in a whole step [J], is not believed
constexpr double kEnergyFloor = 1e-5;

// All bodies to the end of a part of a step. @returns false (nothing has happened) if it is not good enough; the last
// try is always taken
bool World::tryStep(const StepInput& input, double share, bool last, StepReport& report) {
  if (!last) contacts_before_ = state_.contacts;
  const double before = energy_;
  if (input.followed.on) elastic_before_ = elastic_;
  report = last ? stepBodies(all(), input, Ending::held) : stepBodies(all(), input, Ending::free, kTryShare);
  if (!last && report.failed()) {
    std::swap(state_.contacts, contacts_before_);
    return false;
  }
  for (int i = 0; i < bodies() && input.followed.on; ++i) {
    report.energy_corrected += systems_[i]->correctionEnergy(elastic_before_[i]);
  }
  findEnergies(report, input.end_time);
  StepWork work;
  for (int i = 0; i < bodies(); ++i) work += workOn(*systems_[i], state_.bodies[i]);
  // energy that corrections bring is not made, and what they would take away contact can keep
  const double brought = std::max(0.0, report.energy_corrected);
  const double made = energyMade(before + brought, energy_, work, share);
  const bool forced =
      input.followed.on && systems_[tool_]->leadingForce(state_.bodies[tool_]).norm() > input.followed.largest_force;
  if (!last && (forced || made > share * kEnergyFloor)) {
    for (const auto& system : systems_) system->retreat();
    std::swap(state_.contacts, contacts_before_);
    energy_ = before;
    return false;
  }
  work_ += work;
  brought_ += brought;
  return true;
}

// Of the part of a step between two shares of it.
StepInput World::inputAt(const Way& way, double from, double to) const {
  StepInput input;
  input.step = (to - from) * way.step;
  input.gravity = gravity;
  input.link = link;
  input.end_time = state_.time + to * way.step;
  if (way.path == nullptr) {
    input.device = to == 1 ? way.to : between(way.from, way.to, to);
    input.link = linkTo(between(way.from, way.to, from));
    return input;
  }
  const HandleState end = way.path->at(to);
  input.device = {end.pose, end.twist};
  input.turning = true;
  if (way.pulled) {
    const HandleState start = way.path->at(from);
    input.link = linkTo({start.pose, start.twist});
    return input;
  }
  input.followed.on = true;
  input.followed.end = end;
  input.followed.link = way.path->link;
  input.followed.largest_force = way.path->largest_force;
  // as evenly as the path: a shift that a part brings as a whole, and contact does not let in, would be a velocity that
  // the parts after it go on with
  const double share = to - from;
  input.followed.shift = share * way.path->shift;
  input.followed.others = way.path->others;
  for (BodyCorrection& other : input.followed.others) other.shift *= share;
  if (from == 0) {
    input.followed.velocity = way.path->velocity;
  } else {
    for (BodyCorrection& other : input.followed.others) other.velocity.setZero();
  }
  return input;
}

// Whether the budget is likely to last for so many good parts.
bool World::affords(int parts) const {
  double factors = 0;
  for (const auto& system : systems_) factors += system->factorOperations();
  return kPartCost * factors * parts < meter_.left();
}

// What a part's searches cost, by the places that were near: about a pair of clusters for each of them, in two passes.
double World::searchOperations() const {
  return 2.0 * SurfaceContacts::kOperations * static_cast<double>(state_.contacts.near.size());
}

// Into how many halves of halves a part of the step is to be taken from the start, by how the last step bent: as a part
// of half the length bends a quarter as much. What would take too long is not.
int World::bentHalvings(const Way& way, double share) const {
  if (way.path == nullptr) return 0;
  const double length = share * way.step;
  const double allowed = kBentShare * std::min(StepBudget::kOperationsPerSecond * way.step, meter_.whole());
  double bend = state_.bending * length * length, cost = state_.part_cost / share;
  int halvings = 0;
  while (halvings < kMostBent && bend > way.path->largest_bend && 2 * cost <= allowed) {
    ++halvings;
    bend *= 0.25;
    cost *= 2;
  }
  return halvings;
}

// A part of the step, in one or in halves and halves of halves where that fails. Where the budget is used up it ends
// early: a world that is slow for a moment is better than one that is wrong. A failed try that was dear is followed by
// one that is shorter than it would be otherwise: that may fail as well, and at such a price there is no third time.
void World::stepAlong(Way& way, double from, double to, StepReport& sum) {
  int done = 0;  // of the shortest parts
  int successes = 0;
  bent_ = bentHalvings(way, to - from);
  int& halvings = state_.halvings;
  halvings = std::max(bent_, halvings - 1);
  while (done < kShortest) {
    const int length = kShortest >> halvings;
    const auto shareAt = [&](int part) { return part == kShortest ? to : from + (to - from) * part / kShortest; };
    StepReport part;
    const StepInput input = inputAt(way, shareAt(done), shareAt(done + length));
    const bool last = length == 1 && (way.path == nullptr || way.pulled);
    const double spent = meter_.spentButForSearching(), left = meter_.left();
    if (!tryStep(input, static_cast<double>(length) / kShortest, last, part)) {
      sum.times += part.times;
      const double promising = stage_.result().promising;
      const bool leaves_path = way.path != nullptr && !way.pulled;
      way.pulled = way.path != nullptr;
      // pulled it takes about the same way, which costs as much
      if (!leaves_path || (length > 1 && stage_.result().given_up)) ++halvings;
      const int shorter = kShortest >> (halvings + 1);
      const bool dear = meter_.left() < (1.0 - kDearShare) * meter_.whole();
      if (dear && shorter > 0 && affords((kShortest - done) / shorter)) ++halvings;
      while (kShortest >> halvings > 1 && kShortest >> halvings > promising * length) ++halvings;
      successes = 0;
      continue;
    }
    way.good_cost += meter_.spentButForSearching() - spent + searchOperations();
    part.parts = 1;
    if (halvings > bent_) ++part.redone;
    if (input.followed.on) part.corrected_share = shareAt(done + length) - shareAt(done);
    done += length;
    // by the clock a part that would take far longer than there is time is not begun
    const bool late = meter_.timed() && meter_.left() < kLeastTime * (left - meter_.left());
    if ((late || meter_.usedUp()) && done < kShortest) {
      part.out_of_budget = true;
      part.motion_share = std::min(part.motion_share, static_cast<double>(done) / kShortest);
      sum.append(part);
      return;
    }
    sum.append(part);
    if (halvings > bent_ && ++successes >= kGoodParts && done % (kShortest >> (halvings - 1)) == 0) {
      --halvings;
      successes = 0;
    }
  }
  if (halvings == bent_) halvings = 0;
}

StepReport World::step(const DeviceTarget& device, double h, int parts) {
  const StepReport report = walk({state_.aimed ? state_.device : device, device, h}, parts);
  if (device.pose.allFinite() && device.twist.allFinite()) {
    state_.device = device;
    state_.aimed = true;
  }
  return report;
}

StepReport World::follow(const ToolPath& path, double h, int parts) {
  const HandleState& end = path.points.back();
  state_.aimed = false;
  return walk({{}, {end.pose, end.twist}, h, &path}, parts);
}

StepReport World::walk(Way way, int parts) {
  prepare();
  const bool follows = way.path != nullptr && state_.pulled_steps == 0;
  if (way.path != nullptr && !follows) {
    way.pulled = true;
    --state_.pulled_steps;
  }
  meter_.start(budget);
  for (const auto& system : systems_) system->expectNothing();
  StepReport report;
  if (!energy_known_) findEnergies(report, state_.time);
  const double before = energy_;
  work_ = {};
  brought_ = 0;
  if (way.path != nullptr) bend_.begin(models_, state_.bodies, *way.path);
  for (int k = 0; k < parts; ++k) {
    stepAlong(way, static_cast<double>(k) / parts, static_cast<double>(k + 1) / parts, report);
  }
  bent_ = 0;
  state_.bending = way.path != nullptr ? bend_.end(models_, state_.bodies) / way.step : 0.0;
  state_.part_cost = way.good_cost / std::max(report.parts, 1);
  state_.time += way.step;
  report.energy_made = energyMade(before + brought_, energy_, work_);
  if (follows) {
    state_.pulled_after = way.pulled ? std::min(2 * state_.pulled_after + 1, kMostPulled) : 0;
    state_.pulled_steps = state_.pulled_after;
  }
  return report;
}

StepReport World::evaluate(const DeviceTarget& device, double h) {
  meter_.start({0.5 * budget.operations, 0.5 * budget.seconds});
  StepInput input{h, gravity, linkTo(device), device};
  input.end_time = state_.time + h;
  StepReport report = stepBodies(all(), input, Ending::stay);
  findEnergies(report, state_.time);
  return report;
}

// Of the present state, at that time, into the report.
void World::findEnergies(StepReport& report, double time) {
  const ScopedTimer timer(report.times.advance);
  moving_.clear();
  for (int i = 0; i < bodies(); ++i) moving_.add(i, *systems_[i]);
  elastic_.resize(models_.size());
  moving_.forEach([&](int i) { elastic_[i] = systems_[i]->elasticEnergy(state_.bodies[i], time); });
  report.kinetic_energy = report.elastic_energy = 0;
  for (int i = 0; i < bodies(); ++i) {
    report.kinetic_energy += models_[i]->kineticEnergy(state_.bodies[i]);
    report.elastic_energy += elastic_[i];
  }
  energy_ = report.kinetic_energy + report.elastic_energy;
  energy_known_ = true;
}

void World::nearPlanes(const ToolMotion& tool, double reach, std::vector<VertexNearPlane>& out) {
  prepare();
  models_[tool_]->contactFinder().find(tool_, tool.positions, obstacles, reach, out);
}

Contact World::planeContact(const ToolMotion& tool, const VertexNearPlane& near) const {
  Contact c = models_[tool_]->contactFinder().contact(tool_, near, tool.positions, tool.positions, obstacles);
  c.friction = friction_(tool_, FrictionTable::obstacle(c.partner));
  return c;
}

void World::nearSurfaces(const ToolMotion& tool, double ahead, std::vector<Contact>& out) {
  prepare();
  if (!surfaces_.active()) return;
  for (int i = 0; i < bodies(); ++i) {
    const VecX& x = i == tool_ ? tool.positions : state_.bodies[i].positions;
    surfaces_.setStart(i, x);
    surfaces_.setEnd(i, x + ahead * (i == tool_ ? tool.speeds : state_.bodies[i].velocities));
  }
  constexpr double kShare = 0.25;
  surfaces_.allow(kShare * budget.operations);
  const std::size_t first = out.size();
  surfaces_.setAsNow(body(tool_).model.freeNodes() == 0);
  surfaces_.setAhead(true);
  surfaces_.find(contact, friction_, out, tool_);
  surfaces_.setAhead(false);
  surfaces_.setAsNow(false);
  // what carries force between bodies has features that a search need not choose again
  std::vector<std::uint64_t> found;
  for (std::size_t k = first; k < out.size(); ++k) found.push_back(out[k].key);
  std::sort(found.begin(), found.end());
  for (const Contact& c : state_.contacts.loaded) {
    if (c.first.body < 0 || c.second.body < 0 || (c.first.body != tool_ && c.second.body != tool_)) continue;
    if (std::binary_search(found.begin(), found.end(), c.key) || !surfaces_.isNearest(c, contact)) continue;
    surfaces_.follow(c, contact, friction_, out);
  }
}

std::vector<SurfaceOverlap> World::overlaps() {
  prepare();
  std::vector<SurfaceOverlap> out;
  if (surfaces_.active()) {
    const SurfaceContactsState before = surfaces_.state();
    for (int i = 0; i < bodies(); ++i) surfaces_.setStart(i, state_.bodies[i].positions);
    surfaces_.recheckOverlaps();
    surfaces_.examineOverlaps(false);
    out = surfaces_.overlaps();
    surfaces_.restore(before);
  }
  for (int i = 0; i < bodies(); ++i) {
    std::vector<VertexNearPlane> below;
    models_[i]->contactFinder().find(i, state_.bodies[i].positions, obstacles, 0, below);
    std::vector<double> depth(obstacles.size(), 0.0);
    for (const VertexNearPlane& v : below) depth[v.obstacle] = std::max(depth[v.obstacle], -v.gap);
    for (std::size_t o = 0; o < obstacles.size(); ++o) {
      if (depth[o] > 0) out.push_back({{i, -1}, {-1, static_cast<int>(o)}, depth[o]});
    }
  }
  return out;
}

const Obstacle* World::obstacleOf(const Contact& c) const {
  if (c.second.body >= 0) return nullptr;
  const int i = c.features.second_surface < 0 ? c.partner : surfaces_.obstacleOf(c.features.second_surface);
  return i >= 0 ? &obstacles[static_cast<std::size_t>(i)] : nullptr;
}

// As it pulls the handle where it is.
LinkParameters World::linkTo(const DeviceTarget& device) const {
  if (!hasTool()) return link;
  const HandleState& handle = tool().state.handle;
  return saturated(link, handle.pose, handle.twist, device.pose, device.twist);
}

// Of the last step, of a free node's coordinate or a handle's twist [m/s; rad/s].
double World::largestSpeed(const std::vector<int>& of) const {
  double speed = 0;
  for (const int i : of) {
    const BodySystem& b = *systems_[i];
    if (b.endVelocity().size() > 0) speed = std::max(speed, b.endVelocity().cwiseAbs().maxCoeff());
    speed = std::max(speed, b.endTwist().cwiseAbs().maxCoeff());
  }
  return speed;
}

}  // namespace palpate
