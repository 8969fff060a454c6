#include "palpate/simulation/contact_stage.h"

#include <algorithm>
#include <tuple>

namespace palpate {
namespace {

SurfaceContactSettings surfaceSettings(const ContactSettings& settings) { return {settings.thickness, settings.reach}; }

constexpr double kFarOff = 0.1;      // thicknesses that a residual may mean in a step
constexpr double kDeep = 0.5;        // thicknesses below a plane at which a motion is cut short
constexpr double kLargestArc = 5.0;  // thicknesses by which a gap is corrected for the handle's turning

}  // namespace

int ContactSet::active() const { return static_cast<int>(contacts.size()) - count(ContactState::open); }

int ContactSet::count(ContactState state) const {
  return static_cast<int>(
      std::count_if(status.begin(), status.end(), [&](const ContactStatus& s) { return s.state == state; }));
}

// Vertices near planes at the present end velocities; leaves the ends to the surfaces as well.
void ContactStage::findOnPlanes(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                                const ContactInput& input, double reach) {
  candidates_.clear();
  x_end_.resize(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    bodies[b]->endPositions(x_end_[b]);
    bodies[b]->contactFinder().find(indices[b], bodies[b]->startPositions(), x_end_[b], input.obstacles, reach,
                                    candidates_);
    if (input.surfaces.active()) input.surfaces.setEnd(indices[b], x_end_[b]);
  }
  for (Contact& c : candidates_) {
    c.slack = input.settings.penetration_tolerance;
    c.friction = input.friction(c.first.body, FrictionTable::obstacle(c.partner));
  }
}

// What the first pass starts from, without a search among the surfaces: what was near at the end of the step before,
// where it now is. The search follows in any case, along the motion that this leads to.
void ContactStage::propose(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                           const ContactInput& input) {
  findOnPlanes(bodies, indices, input, input.settings.reach);
  if (input.surfaces.active()) {
    const SurfaceContactSettings surface = surfaceSettings(input.settings);
    input.surfaces.findOverlapping(surface, input.friction, candidates_);
    for (const Contact& c : near_) input.surfaces.follow(c, surface, input.friction, candidates_);
  }
  followEarlier(bodies, indices, input);
  correctForTurning(bodies, indices, kLargestArc * input.settings.thickness);
  set_.candidates = static_cast<int>(candidates_.size());
}

// Everything along the motion to the present end velocities.
void ContactStage::search(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                          const ContactInput& input) {
  findOnPlanes(bodies, indices, input, 0.0);
  if (input.surfaces.active()) {
    input.surfaces.find(surfaceSettings(input.settings), input.friction, candidates_);
  }
  correctForTurning(bodies, indices, kLargestArc * input.settings.thickness);
}

// The handle's nodes go round on arcs, their velocity rows straight on: what an arc ends beside the straight line is
// known once the motion is predicted, and belongs to the gap. Within bounds: a wild prediction must not make wild gaps.
void ContactStage::correctForTurning(const std::vector<Body*>& bodies, const std::vector<int>& indices, double bound) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Body& body = *bodies[b];
    if (!body.framed()) continue;
    for (Contact& c : candidates_) {
      const auto offset = [&](const ContactPoint& point) {
        if (point.body != indices[b]) return 0.0;
        return std::clamp(c.normal.dot(body.arcOffset(point, x_end_[b])), -bound, bound);
      };
      c.gap += offset(c.first) - offset(c.second);
    }
  }
}

// Contact on a node that is not ordered last needs a new factor; rare, as nodes near others are ordered last
// beforehand. Those of all candidates then come too, so that the order lasts.
bool ContactStage::prepareNodes(const std::vector<Body*>& bodies, const std::vector<int>& indices) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = *bodies[b];
    bool missing = false;
    for (const Contact& c : set_.contacts) {
      missing |= body.lacksNodes(c.first, indices[b]) || body.lacksNodes(c.second, indices[b]);
    }
    if (!missing) continue;
    std::vector<int> nodes = body.contactNodes();
    for (const std::vector<Contact>* list : {&set_.contacts, &candidates_}) {
      for (const Contact& c : *list) {
        for (const ContactPoint* point : {&c.first, &c.second}) {
          if (point->body == indices[b])
            nodes.insert(nodes.end(), point->node.begin(), point->node.begin() + point->count);
        }
      }
    }
    body.orderContactNodes(nodes);
    if (!body.factorize()) return false;
    body.solveFreeAgain();
  }
  return true;
}

void ContactStage::solveOnce(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                             const ContactSettings& settings) {
  const auto m = static_cast<Eigen::Index>(set_.contacts.size());
  const double h = bodies.front()->input().step;
  set_.delassus.setZero(3 * m, 3 * m);
  set_.free.setZero(3 * m);
  bias_.resize(m);
  friction_.resize(m);
  set_.rows.resize(bodies.size());
  set_.bodies = indices;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    bodies[b]->addDelassus(set_.contacts, indices[b], set_.rows[b], set_.delassus);
    bodies[b]->addFreeRowVelocity(set_.contacts, indices[b], set_.free);
  }
  set_.delassus.triangularView<Eigen::StrictlyUpper>() = set_.delassus.transpose();
  const bool fresh = set_.impulse.size() == 0;
  const Eigen::Index known = set_.impulse.size() / 3;
  set_.impulse.conservativeResize(3 * m);
  set_.status.resize(set_.contacts.size());
  for (Eigen::Index i = 0; i < m; ++i) {
    const Contact& c = set_.contacts[i];
    bias_[i] = -c.gap / h;
    friction_[i] = c.friction;
    if (!fresh && i < known) continue;
    set_.impulse.segment<3>(3 * i).setZero();
    set_.status[i] = {};
    const auto at = std::lower_bound(memory_.begin(), memory_.end(), c.track,
                                     [](const Memory& a, std::uint64_t track) { return a.track < track; });
    if (at != memory_.end() && at->track == c.track) {
      set_.impulse.segment<3>(3 * i) = h * (c.frame() * at->force);
      set_.status[i] = at->status;
    }
  }
  const ContactProblem problem{set_.delassus, set_.free, bias_, friction_, settings.cone};
  set_.solver = solver_.solve(problem, settings.solver, set_.impulse, set_.status);
  for (std::size_t b = 0; b < bodies.size(); ++b) bodies[b]->applyImpulse(set_.rows[b], set_.impulse);
}

// The deepest violated point of each patch; a contact that is there already is linearized anew where it now is.
bool ContactStage::addViolated() {
  std::sort(candidates_.begin(), candidates_.end(), [](const Contact& a, const Contact& b) {
    return std::tuple(a.first.body, a.partner, a.patch, a.end_gap, a.key) <
           std::tuple(b.first.body, b.partner, b.patch, b.end_gap, b.key);
  });
  const auto samePatch = [](const Contact& a, const Contact& b) {
    return a.first.body == b.first.body && a.partner == b.partner && a.patch == b.patch;
  };
  bool added = false;
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    const Contact& c = candidates_[i];
    if (!c.crosses() && !(c.end_gap < -c.slack)) continue;
    if (i > 0 && samePatch(candidates_[i - 1], c) && c.normal.dot(candidates_[i - 1].normal) > 0.7) continue;
    const auto same =
        std::find_if(set_.contacts.begin(), set_.contacts.end(), [&](const Contact& o) { return o.key == c.key; });
    if (same == set_.contacts.end()) {
      set_.contacts.push_back(c);
    } else {
      *same = c;
    }
    added = true;
  }
  return added;
}

// Where the bodies will be if the contacts of the step before go on as they were: a far better guess than free motion,
// in which a body at rest falls a centimeter in a step of 33 ms and all of its lower side would be a candidate.
void ContactStage::predict(const std::vector<Body*>& bodies, const std::vector<int>& indices) {
  if (earlier_.empty()) return;
  earlier_impulse_ = earlier_force_ * bodies.front()->input().step;
  for (std::size_t b = 0; b < bodies.size(); ++b) bodies[b]->predict(earlier_, indices[b], earlier_impulse_);
}

// What carried force on a plane in the step before is a candidate wherever the prediction puts it.
void ContactStage::followEarlier(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                                 const ContactInput& input) {
  found_.clear();
  for (const Contact& c : candidates_) found_.push_back(c.key);
  std::sort(found_.begin(), found_.end());
  for (const Contact& c : earlier_) {
    if (c.partner >= static_cast<int>(input.obstacles.size())) continue;
    if (std::binary_search(found_.begin(), found_.end(), c.key)) continue;
    const auto at = std::find(indices.begin(), indices.end(), c.first.body);
    if (at == indices.end()) continue;
    const auto b = static_cast<std::size_t>(at - indices.begin());
    candidates_.push_back(
        bodies[b]->contactFinder().follow(c, bodies[b]->startPositions(), x_end_[b], input.obstacles));
  }
}

// Deep overlap is undone at a bounded speed: without the cap a start 1 cm deep would leave at 0.3 m/s, or 10 m/s where
// steps are short.
void ContactStage::capRecovery(double h, double speed) {
  for (Contact& c : set_.contacts) {
    if (c.gap >= -speed * h) continue;
    c.gap = -speed * h;
    c.capped = true;
  }
}

void ContactStage::remember(double h) {
  memory_.clear();
  kept_.clear();
  earlier_.clear();
  earlier_force_.resize(static_cast<Eigen::Index>(3 * set_.active()));
  for (std::size_t i = 0; i < set_.contacts.size(); ++i) {
    if (set_.status[i].state == ContactState::open) continue;
    const Contact& c = set_.contacts[i];
    const auto impulse = set_.impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
    memory_.push_back({c.track, c.frame().transpose() * impulse / h, set_.status[i]});
    earlier_force_.segment<3>(static_cast<Eigen::Index>(3 * earlier_.size())) = impulse / h;
    earlier_.push_back(c);
  }
  std::stable_sort(memory_.begin(), memory_.end(), [](const Memory& a, const Memory& b) { return a.track < b.track; });
  for (const Memory& m : memory_) kept_.push_back(m.track);
}

// What the next step starts from: what is near at the end, and what was a contact.
void ContactStage::rememberNear(const ContactInput& input) {
  near_.clear();
  found_.clear();
  const auto keep = [&](const Contact& c) {
    if (c.features.first < 0) return;
    const auto at = std::lower_bound(found_.begin(), found_.end(), c.key);
    if (at != found_.end() && *at == c.key) return;
    found_.insert(at, c.key);
    near_.push_back(c);
  };
  for (const Contact& c : set_.contacts) keep(c);
  for (const Contact& c : candidates_) {
    if (!c.crosses() && c.end_gap < input.settings.reach) keep(c);
  }
}

void ContactStage::chooseContacts(const std::vector<Body*>& bodies, const ContactSettings& settings) {
  touched_.clear();
  for (const Contact& c : candidates_) {
    for (const ContactPoint* point : {&c.first, &c.second}) {
      if (point->body < 0) continue;
      for (int k = 0; k < point->count; ++k) touched_.emplace_back(point->body, point->node[k]);
    }
  }
  std::sort(touched_.begin(), touched_.end());
  touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
  if (!settings.reduce) {
    set_.contacts = candidates_;
    return;
  }
  double spacing = bodies.front()->contactFinder().edgeLength();
  for (const Body* b : bodies) spacing = std::min(spacing, b->contactFinder().edgeLength());
  for (const int i : reduction_.choose(candidates_, kept_, settings.spacing * spacing)) {
    set_.contacts.push_back(candidates_[i]);
  }
}

void ContactStage::touchedNodes(int body, int nodes, std::vector<int>& out) const {
  for (auto at = std::lower_bound(touched_.begin(), touched_.end(), std::pair(body, 0));
       at != touched_.end() && at->first == body && at->second < nodes; ++at) {
    out.push_back(at->second);
  }
}

// Depth and crossing of the present end velocities, from the candidates there.
void ContactStage::judge(const ContactSettings& settings) {
  set_.penetration = 0;
  set_.crossing = false;
  for (const Contact& c : candidates_) {
    const double depth = -c.end_gap - c.thickness;
    if (c.crosses()) {
      set_.crossing = true;
    } else {
      set_.penetration = std::max(set_.penetration, depth);
      set_.crossing |= depth > kDeep * settings.thickness;
    }
  }
}

bool ContactStage::solve(const std::vector<Body*>& bodies, const std::vector<int>& indices, const ContactInput& input) {
  const ContactSettings& settings = input.settings;
  set_.contacts.clear();
  set_.impulse.resize(0);
  set_.status.clear();
  set_.rows.clear();
  set_.solver = {true, 0, 0.0};
  set_.passes = 0;
  set_.candidates = 0;
  set_.penetration = 0;
  set_.crossing = false;
  if (bodies.empty()) return true;
  const double h = bodies.front()->input().step;
  predict(bodies, indices);
  propose(bodies, indices, input);
  chooseContacts(bodies, settings);
  if (set_.contacts.empty()) {  // what was touched is out of reach: its impulses are, too
    for (Body* b : bodies) b->applyImpulse({}, VecX());
  }
  int iterations = 0;
  for (;;) {
    if (!set_.contacts.empty()) {
      ++set_.passes;
      capRecovery(h, settings.recovery_speed);
      if (!prepareNodes(bodies, indices)) {
        set_ = ContactSet{};
        return false;
      }
      solveOnce(bodies, indices, settings);
      iterations += set_.solver.iterations;
    }
    search(bodies, indices, input);
    judge(settings);
    // a solution that is far off says nothing about what else would touch
    const bool far_off = !set_.solver.converged && set_.solver.residual * h > kFarOff * settings.thickness;
    if (far_off || set_.passes >= settings.max_passes || !addViolated()) break;
  }
  set_.candidates = std::max(set_.candidates, static_cast<int>(candidates_.size()));
  set_.penetration = std::max(set_.penetration, input.surfaces.overlap());
  set_.solver.iterations = iterations;
  remember(h);
  rememberNear(input);
  return true;
}

// Vertices that would go deep into a plane, as if they met something there. What is deep already may come out.
void ContactStage::stopAtPlanes(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                                const ContactInput& input) {
  const std::size_t begin = candidates_.size();
  const double deep = -kDeep * input.settings.thickness;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    bodies[b]->contactFinder().find(indices[b], bodies[b]->startPositions(), x_end_[b], input.obstacles, 0.0,
                                    candidates_);
  }
  set_.penetration = 0;
  for (std::size_t i = begin; i < candidates_.size(); ++i) {
    Contact& c = candidates_[i];
    set_.penetration = std::max(set_.penetration, -c.end_gap);
    if (c.end_gap < deep && c.gap > deep && c.end_gap < c.gap)
      c.impact_time = std::max(0.9 * (c.gap - deep) / (c.gap - c.end_gap), 0.0);
  }
}

// Cuts motions short, of the bodies that would cross, until nothing crosses. The cut path is examined again: a handle
// that turns does not end on the straight way to where it would have been.
void ContactStage::limitMotion(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                               const ContactInput& input, std::vector<double>& share) {
  constexpr int kRounds = 12;
  constexpr int kPatient = 6;  // rounds after which a motion is cut by more than the impact asks
  share.assign(bodies.size(), 1.0);
  if (!set_.crossing) return;
  const SurfaceContactSettings surface = surfaceSettings(input.settings);
  std::vector<double> next;
  for (int round = 0; round <= kRounds; ++round) {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      bodies[b]->endPositions(x_end_[b], share[b]);
      input.surfaces.setEnd(indices[b], x_end_[b]);
    }
    candidates_.clear();
    input.surfaces.find(surface, input.friction, candidates_);
    stopAtPlanes(bodies, indices, input);
    next = share;
    bool crossing = false;
    for (const Contact& c : candidates_) {
      if (!c.crosses()) continue;
      crossing = true;
      double factor = round < kPatient ? c.impact_time : 0.5 * c.impact_time;
      if (round == kRounds) factor = 0;
      for (const ContactPoint* point : {&c.first, &c.second}) {
        const auto at = std::find(indices.begin(), indices.end(), point->body);
        if (at == indices.end()) continue;
        const auto b = static_cast<std::size_t>(at - indices.begin());
        next[b] = std::min(next[b], factor * share[b]);
      }
    }
    if (!crossing) return;
    share = next;
  }
}

}  // namespace palpate
