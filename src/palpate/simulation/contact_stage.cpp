#include "palpate/simulation/contact_stage.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace palpate {
namespace {

constexpr double kFarOff = 0.1;           // thicknesses that a residual may mean in a step
constexpr int kLastPasses = 4;            // in a try whose end is limited in any case, where the budget is used up
constexpr int kLastNew = 8;               // as many times as many new places as in others
constexpr double kLeastOperations = 1e6;  // of a solve, also where nothing is left: a tenth of a millisecond
constexpr double kDeep = 0.5;             // thicknesses below a plane at which a motion is cut short
constexpr double kLargestArc = 5.0;       // thicknesses by which a gap is corrected for what turns
constexpr double kLittle = 0.5;           // thicknesses that surfaces may lack of the gap that they keep
constexpr double kRecovery = 0.033;       // [s] in which they get it back
constexpr double kStill = 1e-3;           // thicknesses by which a pass that changes nothing moves a node

const ContactFinder& finderOf(const BodySystem& body) { return body.model().contactFinder(); }

// For each body that moves the contacts in which it takes part, increasing.
template <class Rows>
void listByBody(const std::vector<Contact>& contacts, const MovingBodies& bodies, std::vector<Rows>& rows) {
  for (Rows& own : rows) own.contacts.clear();
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const int first = bodies.slot(contacts[i].first), second = bodies.slot(contacts[i].second);
    if (first >= 0) rows[first].contacts.push_back(static_cast<int>(i));
    if (second >= 0 && second != first) rows[second].contacts.push_back(static_cast<int>(i));
  }
}

}  // namespace

bool ContactStage::solve(const MovingBodies& bodies, const ContactInput& input, ContactMemory& memory) {
  const ContactSettings& settings = input.settings;
  set_.begin(bodies.indices());
  if (bodies.empty()) {
    set_.islands.clear();
    return true;
  }
  const double h = bodies[0].input().step;
  predict(bodies, memory);
  propose(bodies, input, memory);
  choose(bodies, input, memory);
  int iterations = 0;
  const WorkShare work(input.work, input.share, calmOperations(bodies, memory));
  for (;;) {
    if (!set_.contacts.empty()) {
      if (!solvePass(bodies, input, work, memory)) return false;
      iterations += set_.solver.iterations;
      if (input.share > 0 && resisted(bodies)) {
        set_.resisted = true;
        break;
      }
    }
    if (!search(bodies, input, work)) {
      set_.given_up = true;
      break;
    }
    judge(settings);
    if (set_.passes <= 1) set_.promising = promisingShare(mostNew(bodies) / 2);
    const bool still = set_.passes > 1 && largestChange() < kStill * settings.thickness;
    x_before_ = x_end_;
    // a solution that is far off says nothing about what else would touch
    const bool far_off = !set_.solver.converged && set_.solver.residual * h > kFarOff * settings.thickness;
    const bool hurried = input.share == 0 && input.work.usedUp();
    if (far_off || still || work.left() <= 0 || set_.passes >= (hurried ? kLastPasses : settings.max_passes)) break;
    const auto [crossing, fresh] = findViolated();
    if (violated_.empty()) break;
    const bool first = set_.passes <= 1, need_not = input.share > 0;
    if (need_not ? (first ? crossing : fresh) > mostNew(bodies) : !first && fresh > kLastNew * mostNew(bodies)) {
      set_.given_up = true;
      break;
    }
    addViolated(bodies, settings);
  }
  if (set_.contacts.empty()) set_.islands.clear();
  set_.candidates = std::max(set_.candidates, static_cast<int>(candidates_.size()));
  set_.penetration = std::max(set_.penetration, input.surfaces.overlap());
  set_.solver.iterations = iterations;
  remember(h, settings, memory);
  return true;
}

// Whether a tool that is led meets what it is not led through, which no search need find out: more contacts hardly make
// it less.
bool ContactStage::resisted(const MovingBodies& bodies) {
  for (int b = 0; b < bodies.size(); ++b) {
    if (bodies[b].resists()) return true;
  }
  return false;
}

// Where the bodies will be if the contacts of the step before go on as they were: a far better guess than free motion,
// in which a body at rest falls a centimeter in a step of 33 ms and all of its lower side would be a candidate.
void ContactStage::predict(const MovingBodies& bodies, const ContactMemory& memory) {
  if (memory.loaded.empty()) return;
  const VecX impulse = memory.loaded_force * bodies[0].input().step;
  loaded_rows_.resize(static_cast<std::size_t>(bodies.size()));
  listByBody(memory.loaded, bodies, loaded_rows_);
  bodies.forEach([&](int b) { bodies[b].predict(memory.loaded, loaded_rows_[b], bodies.index(b), impulse); });
}

// Vertices near planes at the present end velocities; leaves the ends to the surfaces as well.
void ContactStage::findOnPlanes(const MovingBodies& bodies, const ContactInput& input, double reach) {
  candidates_.clear();
  x_end_.resize(static_cast<std::size_t>(bodies.size()));
  for (int b = 0; b < bodies.size(); ++b) {
    bodies[b].endPositions(x_end_[b]);
    finderOf(bodies[b]).find(bodies.index(b), bodies[b].startPositions(), x_end_[b], input.obstacles, reach,
                             candidates_);
    if (input.surfaces.active()) input.surfaces.setEnd(bodies.index(b), x_end_[b]);
  }
  for (Contact& c : candidates_) {
    c.slack = input.settings.penetration_tolerance;
    c.friction = input.friction(c.first.body, FrictionTable::obstacle(c.partner));
  }
}

// What the first pass starts from, without a search among the surfaces: what was near at the end of the step before,
// where it now is. The search follows in any case, along the motion that this leads to.
void ContactStage::propose(const MovingBodies& bodies, const ContactInput& input, const ContactMemory& memory) {
  findOnPlanes(bodies, input, input.settings.margin);
  if (input.surfaces.active()) {
    input.surfaces.findOverlapping(input.settings, input.friction, candidates_);
    for (const Contact& c : memory.near) input.surfaces.follow(c, input.settings, input.friction, candidates_);
  }
  followLoaded(bodies, input, memory);
  dropImmovable(bodies);
  correctForTurning(bodies, kLargestArc * input.settings.thickness, candidates_);
  set_.candidates = static_cast<int>(candidates_.size());
}

// What carried force on a plane in the step before is a candidate wherever the prediction puts it.
void ContactStage::followLoaded(const MovingBodies& bodies, const ContactInput& input, const ContactMemory& memory) {
  found_.clear();
  for (const Contact& c : candidates_) found_.push_back(c.key);
  std::sort(found_.begin(), found_.end());
  for (const Contact& c : memory.loaded) {
    if (c.glued() || c.partner >= static_cast<int>(input.obstacles.size())) continue;
    if (std::binary_search(found_.begin(), found_.end(), c.key)) continue;
    const int b = bodies.slot(c.first);
    if (b < 0) continue;
    candidates_.push_back(finderOf(bodies[b]).follow(c, bodies[b].startPositions(), x_end_[b], input.obstacles));
  }
}

// Appends; may be given up beyond so many operations.
void ContactStage::findOnSurfaces(const ContactInput& input, double allowed) {
  input.surfaces.allow(allowed);
  input.surfaces.find(input.settings, input.friction, candidates_);
  input.work.spendSearching(input.surfaces.operations());
}

// Everything along the motion to the present end velocities. @returns false if it was given up, which a last try never
// is
bool ContactStage::search(const MovingBodies& bodies, const ContactInput& input, const WorkShare& work) {
  findOnPlanes(bodies, input, 0.0);
  if (input.surfaces.active()) {
    findOnSurfaces(input, input.share > 0 ? work.left() : std::numeric_limits<double>::infinity());
    if (input.surfaces.gaveUp()) return false;
  }
  dropImmovable(bodies);
  correctForTurning(bodies, kLargestArc * input.settings.thickness, candidates_);
  return true;
}

// The handle's nodes go round on arcs, their velocity rows straight on: what an arc ends beside the straight line is
// known once the motion is predicted, and belongs to the gap. Within bounds: a wild prediction must not make wild gaps.
void ContactStage::correctForTurning(const MovingBodies& bodies, double bound, std::vector<Contact>& contacts) const {
  bool framed = false;
  for (int b = 0; b < bodies.size(); ++b) framed |= bodies[b].model().framed();
  if (!framed) return;
  for (Contact& c : contacts) {
    const auto offset = [&](const ContactPoint& point, const Vec3& along) {
      const int b = bodies.slot(point);
      if (b < 0 || !bodies[b].model().framed()) return 0.0;
      return std::clamp(along.dot(bodies[b].arcOffset(point, x_end_[b])), -bound, bound);
    };
    c.gap += offset(c.first, c.normal) - offset(c.second, c.normal);
    if (!c.glued()) continue;
    c.tangent_gap[0] += offset(c.first, c.tangent1) - offset(c.second, c.tangent1);
    c.tangent_gap[1] += offset(c.first, c.tangent2) - offset(c.second, c.tangent2);
  }
}

// Comes first, and is never chosen from: each node has equalities of its own. A gap that something has torn open closes
// at a bounded speed.
void ContactStage::takeGlued(const MovingBodies& bodies, const ContactInput& input) {
  set_.contacts.clear();
  set_.glued = 0;
  if (input.glued == nullptr || input.glued->empty()) return;
  set_.contacts = *input.glued;
  set_.glued = static_cast<int>(set_.contacts.size());
  correctForTurning(bodies, kLargestArc * input.settings.thickness, set_.contacts);
  const double most = input.settings.max_recovery_speed * bodies[0].input().step;
  for (Contact& c : set_.contacts) {
    const double gap = Vec3(c.gap, c.tangent_gap[0], c.tangent_gap[1]).norm();
    if (gap <= most) continue;
    c.gap *= most / gap;
    for (double& along : c.tangent_gap) along *= most / gap;
    c.follows = 0;
  }
}

// What a calm step takes, with room: solving contact three times what the factorizations do, and a search that has no
// front to go on from about one pair of clusters for each of the places that were near, in each of two passes.
double ContactStage::calmOperations(const MovingBodies& bodies, const ContactMemory& memory) const {
  constexpr double kSystems = 3.0, kSearches = 4.0;
  double systems = gluedOperations(bodies);
  for (int b = 0; b < bodies.size(); ++b) systems += bodies[b].factorOperations();
  return kSystems * systems + kSearches * SurfaceContacts::kOperations * static_cast<double>(memory.near.size());
}

// What it costs to take out what is glued: as the bodies' systems do, it costs that in any try.
double ContactStage::gluedOperations(const MovingBodies& bodies) const {
  if (set_.glued == 0) return 0;
  const double all = 3.0 * set_.glued;
  double sum = BodySystem::kDense * all * all * all / 3;
  for (int b = 0; b < bodies.size(); ++b) {
    double own = 0;
    for (int i = 0; i < set_.glued; ++i) {
      if (bodies.slot(set_.contacts[i].first) == b || bodies.slot(set_.contacts[i].second) == b) own += 3;
    }
    sum += bodies[b].rowOperations(own, own);
  }
  return sum;
}

// What no impulse can move has nothing to solve: where nodes that are fixed to the world lie in an obstacle.
void ContactStage::dropImmovable(const MovingBodies& bodies) {
  bool fixed = false;
  for (int b = 0; b < bodies.size(); ++b) fixed |= !bodies[b].model().fixedElements().empty();
  if (!fixed) return;
  const auto moves = [&](const ContactPoint& point) {
    const int b = bodies.slot(point);
    return b >= 0 && bodies[b].canMove(point);
  };
  std::erase_if(candidates_, [&](const Contact& c) { return !moves(c.first) && !moves(c.second); });
}

void ContactStage::choose(const MovingBodies& bodies, const ContactInput& input, const ContactMemory& memory) {
  const ContactSettings& settings = input.settings;
  takeGlued(bodies, input);
  touched_.clear();
  for (const std::vector<Contact>* list : {&std::as_const(set_.contacts), &std::as_const(candidates_)}) {
    for (const Contact& c : *list) {
      for (const ContactPoint* point : {&c.first, &c.second}) {
        if (point->body < 0) continue;
        for (int k = 0; k < point->count; ++k) touched_.emplace_back(point->body, point->node[k]);
      }
    }
  }
  std::sort(touched_.begin(), touched_.end());
  touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
  if (settings.reduction) {
    double edge = finderOf(bodies[0]).edgeLength();
    for (int b = 0; b < bodies.size(); ++b) edge = std::min(edge, finderOf(bodies[b]).edgeLength());
    memory.tracks(tracks_);
    soft_.clear();
    for (int b = 0; b < bodies.size(); ++b) {
      if (bodies[b].model().isRigid()) continue;
      soft_.resize(std::max<std::size_t>(soft_.size(), bodies.index(b) + 1), 0);
      soft_[bodies.index(b)] = 1;
    }
    for (const int i : reduction_.choose(candidates_, tracks_, settings.spacing * edge, soft_)) {
      set_.contacts.push_back(candidates_[i]);
    }
  } else {
    set_.contacts.insert(set_.contacts.end(), candidates_.begin(), candidates_.end());
  }
  changed_.assign(set_.contacts.size(), 1);
  if (set_.contacts.empty()) {  // what was touched is out of reach: its impulses are, too
    for (int b = 0; b < bodies.size(); ++b) bodies[b].applyImpulse({}, {}, -1, VecX());
  }
}

// More places than these that would cross after the first pass: the motion says little about where contact will be, and
// passes would add them all, and others next time. The more nodes a body has, the more may touch at once.
int ContactStage::mostNew(const MovingBodies& bodies) {
  constexpr int kLeast = 40, kShare = 5, kOfRigid = 400;
  constexpr int kNone = std::numeric_limits<int>::max();
  int nodes = kNone;
  for (int b = 0; b < bodies.size(); ++b) {
    if (!bodies[b].model().isRigid()) nodes = std::min(nodes, bodies[b].model().nodes());
  }
  return nodes < kNone ? std::max(kLeast, nodes / kShare) : kOfRigid;
}

// Of the motion: before so many places would cross.
double ContactStage::promisingShare(int places) {
  std::vector<std::pair<double, std::uint64_t>>& times = crossing_times_;
  times.clear();
  for (const Contact& c : candidates_) {
    if (c.crosses()) times.emplace_back(c.impact_time, contactKey(static_cast<std::uint64_t>(c.partner), c.patch));
  }
  if (static_cast<int>(times.size()) <= places) return 1.0;
  std::sort(times.begin(), times.end());
  found_.clear();
  for (const auto& [time, place] : times) {
    const auto at = std::lower_bound(found_.begin(), found_.end(), place);
    if (at != found_.end() && *at == place) continue;
    found_.insert(at, place);
    if (static_cast<int>(found_.size()) > places) return time;
  }
  return 1.0;
}

// Of a coordinate of the ends, since the search before [m].
double ContactStage::largestChange() const {
  double largest = 0;
  for (std::size_t b = 0; b < x_end_.size(); ++b) {
    if (x_end_[b].size() > 0) largest = std::max(largest, (x_end_[b] - x_before_[b]).lpNorm<Eigen::Infinity>());
  }
  return largest;
}

// What the row of a contact says its end is, beside where it is: features turn, and the points on them that are nearest
// change. What the row misses at the present velocities belongs to the gap, or the next pass would end where this one
// did.
void ContactStage::correctRow(const MovingBodies& bodies, double bound, Contact& c) {
  Vec3 approach = Vec3::Zero();
  if (const int b = bodies.slot(c.first); b >= 0) approach += bodies[b].pointVelocity(c.first);
  if (const int b = bodies.slot(c.second); b >= 0) approach -= bodies[b].pointVelocity(c.second);
  const double missed = c.end_gap - (c.gap + bodies[0].input().step * approach.dot(c.normal));
  if (missed < 0) c.gap += std::max(missed, -bound);
}

// The deepest violated point of each patch, as indices of candidates, into violated_. @returns how many of them are no
// contacts yet, of those that would cross and of all
std::pair<int, int> ContactStage::findViolated() {
  std::sort(candidates_.begin(), candidates_.end(), [](const Contact& a, const Contact& b) {
    return std::tuple(a.first.body, a.partner, a.patch, a.end_gap, a.key) <
           std::tuple(b.first.body, b.partner, b.patch, b.end_gap, b.key);
  });
  keys_.clear();
  for (std::size_t i = 0; i < set_.contacts.size(); ++i) keys_.emplace_back(set_.contacts[i].key, i);
  std::sort(keys_.begin(), keys_.end());
  violated_.clear();
  int crossing = 0, all = 0;
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    const Contact& c = candidates_[i];
    if (!c.crosses() && !(c.end_gap < -c.slack)) continue;
    if (i > 0 && samePatch(candidates_[i - 1], c) && c.normal.dot(candidates_[i - 1].normal) > 0.7) continue;
    violated_.push_back(static_cast<int>(i));
    const auto same = std::lower_bound(keys_.begin(), keys_.end(), std::pair(c.key, 0));
    if (same != keys_.end() && same->first == c.key) continue;
    ++all;
    crossing += c.crosses() ? 1 : 0;
  }
  return {crossing, all};
}

// They become contacts; one that is there already is linearized anew where it now is.
void ContactStage::addViolated(const MovingBodies& bodies, const ContactSettings& settings) {
  changed_.assign(set_.contacts.size(), 0);
  for (const int i : violated_) {
    const Contact& c = candidates_[static_cast<std::size_t>(i)];
    const auto same = std::lower_bound(keys_.begin(), keys_.end(), std::pair(c.key, 0));
    if (same != keys_.end() && same->first == c.key) {
      set_.contacts[same->second] = c;
      correctRow(bodies, kLargestArc * settings.thickness, set_.contacts[same->second]);
      changed_[same->second] = 1;
    } else {
      keys_.insert(same, {c.key, static_cast<int>(set_.contacts.size())});
      set_.contacts.push_back(c);
      changed_.push_back(1);
    }
  }
}

// Deep overlap is undone at a bounded speed: without the cap a start 1 cm deep would leave at 0.3 m/s, or 10 m/s where
// steps are short. What is a little nearer than the gap that surfaces keep, as a new pair of features may be, has time:
// undone within one short step it would be a kick, and the harder the shorter the step.
void ContactStage::capRecovery(double h, double speed) {
  for (std::size_t i = 0; i < set_.contacts.size(); ++i) {
    Contact& c = set_.contacts[i];
    if (c.glued() || changed_[i] == 0 || c.gap >= 0) continue;
    const double share = std::min(1.0, h / kRecovery), little = kLittle * c.thickness;
    if (-c.gap < little) {
      c.gap *= share;
      c.follows = share;
    } else {
      c.gap += (1.0 - share) * little;
    }
    if (c.gap >= -speed * h) continue;
    c.gap = -speed * h;
    c.follows = 0;
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

// W, the impulses of the present contacts, and the end velocities under them.
bool ContactStage::solvePass(const MovingBodies& bodies, const ContactInput& input, const WorkShare& work,
                             const ContactMemory& memory) {
  const double h = bodies[0].input().step;
  ContactSettings settings = input.settings;
  ++set_.passes;
  capRecovery(h, settings.max_recovery_speed);
  listByBody(set_.contacts, bodies, set_.rows);
  if (!prepareNodes(bodies)) {
    set_ = ContactSet{};
    return false;
  }
  islands_.findIslands(bodies, changed_, set_);
  set_.free.setZero(static_cast<Eigen::Index>(3 * set_.contacts.size()));
  bodies.forEach([&](int b) { bodies[b].contactRows(set_.contacts, bodies.index(b), changed_, set_.rows[b]); });
  for (int b = 0; b < bodies.size(); ++b) input.work.spend(bodies[b].contactOperations(set_.rows[b]));
  for (int b = 0; b < bodies.size(); ++b) {  // in this order: bodies share contacts
    bodies[b].addFreeRowVelocity(set_.contacts, set_.rows[b], bodies.index(b), set_.free);
  }
  warmStart(h, memory);
  double scale = set_.free.lpNorm<Eigen::Infinity>();
  for (const Contact& c : set_.contacts) scale = std::max(scale, std::abs(c.gap) / h);
  settings.solver.max_operations = std::min(settings.solver.max_operations, std::max(work.left(), kLeastOperations));
  islands_.solve(h, scale, settings, set_);
  input.work.spend(set_.solver.operations);
  bodies.forEach([&](int b) {
    if (!islands_.keptFor(set_.rows[b], set_)) {
      bodies[b].applyImpulse(set_.contacts, set_.rows[b], bodies.index(b), set_.impulse);
    }
  });
  return true;
}

// Contact on a node that is not ordered last needs a new factor; rare, as nodes near others are ordered last
// beforehand. Those of all candidates then come too, so that the order lasts.
bool ContactStage::prepareNodes(const MovingBodies& bodies) {
  for (int b = 0; b < bodies.size(); ++b) {
    BodySystem& body = bodies[b];
    const int index = bodies.index(b);
    bool missing = false;
    for (const int i : set_.rows[b].contacts) {
      const Contact& c = set_.contacts[i];
      missing |= body.lacksNodes(c.first, index) || body.lacksNodes(c.second, index);
    }
    if (!missing) continue;
    std::vector<int> nodes;
    for (const std::vector<Contact>* list : {&set_.contacts, &candidates_}) {
      for (const Contact& c : *list) {
        for (const ContactPoint* point : {&c.first, &c.second}) {
          if (point->body != index) continue;
          nodes.insert(nodes.end(), point->node.begin(), point->node.begin() + point->count);
        }
      }
    }
    body.addContactNodes(nodes);
    if (!body.factorize()) return false;
    body.solveFreeAgain();
  }
  return true;
}

// Impulses and states of contacts that are new in this pass, from the step before.
void ContactStage::warmStart(double h, const ContactMemory& memory) {
  const auto m = static_cast<Eigen::Index>(set_.contacts.size());
  const Eigen::Index known = set_.impulse.size() / 3;
  set_.impulse.conservativeResize(3 * m);
  set_.status.resize(set_.contacts.size());
  for (Eigen::Index i = known; i < m; ++i) {
    const Contact& c = set_.contacts[i];
    set_.impulse.segment<3>(3 * i).setZero();
    set_.status[i] = {};
    if (const ContactMemory::Force* before = memory.find(c.track)) {
      set_.impulse.segment<3>(3 * i) = h * (c.frame() * before->force);
      set_.status[i] = before->status;
    }
  }
}

void ContactStage::remember(double h, const ContactSettings& settings, ContactMemory& memory) {
  memory.forces.clear();
  memory.loaded.clear();
  memory.loaded_force.resize(static_cast<Eigen::Index>(3 * (set_.glued + set_.active())));
  for (std::size_t i = 0; i < set_.contacts.size(); ++i) {
    if (set_.status[i].state == ContactState::open) continue;
    const Contact& c = set_.contacts[i];
    const auto impulse = set_.impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
    memory.forces.push_back({c.track, c.frame().transpose() * impulse / h, set_.status[i]});
    memory.loaded_force.segment<3>(static_cast<Eigen::Index>(3 * memory.loaded.size())) = impulse / h;
    memory.loaded.push_back(c);
  }
  std::stable_sort(memory.forces.begin(), memory.forces.end(),
                   [](const ContactMemory::Force& a, const ContactMemory::Force& b) { return a.track < b.track; });
  rememberNear(settings, memory);
  memory.touched = touched_;
}

// What is near at the end, and what was a contact.
void ContactStage::rememberNear(const ContactSettings& settings, ContactMemory& memory) {
  memory.near.clear();
  found_.clear();
  const auto keep = [&](const Contact& c) {
    if (c.features.first < 0) return;
    const auto at = std::lower_bound(found_.begin(), found_.end(), c.key);
    if (at != found_.end() && *at == c.key) return;
    found_.insert(at, c.key);
    memory.near.push_back(c);
  };
  for (const Contact& c : set_.contacts) keep(c);
  for (const Contact& c : candidates_) {
    if (!c.crosses() && c.end_gap < settings.margin) keep(c);
  }
}

// Vertices that would go deep into a plane, as if they met something there. What is deep already may come out.
void ContactStage::stopAtPlanes(const MovingBodies& bodies, const ContactInput& input) {
  const std::size_t begin = candidates_.size();
  const double deep = -kDeep * input.settings.thickness;
  for (int b = 0; b < bodies.size(); ++b) {
    finderOf(bodies[b]).find(bodies.index(b), bodies[b].startPositions(), x_end_[b], input.obstacles, 0.0, candidates_);
  }
  set_.penetration = 0;
  for (std::size_t i = begin; i < candidates_.size(); ++i) {
    Contact& c = candidates_[i];
    set_.penetration = std::max(set_.penetration, -c.end_gap);
    if (c.end_gap < deep && c.gap > deep && c.end_gap < c.gap)
      c.impact_time = std::max(0.9 * (c.gap - deep) / (c.gap - c.end_gap), 0.0);
  }
}

constexpr int kLimitRounds = 24;
constexpr int kPointRounds = 6;   // after these the features move as one, not only where they are nearest now
constexpr int kLocalRounds = 22;  // after these the whole body stops

// Makes a pair that would cross come no nearer than where it meets, by an impulse on its nodes as free masses.
void ContactStage::holdBack(const MovingBodies& bodies, const Contact& c) {
  const int first = bodies.slot(c.first), second = bodies.slot(c.second);
  Vec3 approach = Vec3::Zero();
  Mat3 w = Mat3::Zero();
  if (first >= 0) {
    approach += bodies[first].pointVelocity(c.first);
    w += bodies[first].pointInverseMass(c.first);
  }
  if (second >= 0) {
    approach -= bodies[second].pointVelocity(c.second);
    w += bodies[second].pointInverseMass(c.second);
  }
  approach = std::min(approach.dot(c.normal), 0.0) * c.normal;
  const Vec3 impulse = w.inverse() * ((0.9 * c.impact_time - 1.0) * approach);
  if (!impulse.allFinite()) return;
  if (first >= 0) bodies[first].pushPoint(c.first, impulse);
  if (second >= 0) bodies[second].pushPoint(c.second, -impulse);
}

// @returns whether anything would cross
bool ContactStage::holdBackCrossing(const MovingBodies& bodies, int round) {
  bool crossing = false;
  if (round == 0) zones_.clear();
  for (const Contact& c : candidates_) {
    if (!c.crosses()) continue;
    crossing = true;
    if (round < kPointRounds) {
      holdBack(bodies, c);
    } else if (round < kLocalRounds) {
      zones_.join(bodies, c);
    } else {
      for (const ContactPoint* point : {&c.first, &c.second}) {
        if (bodies.slot(*point) >= 0) bodies[bodies.slot(*point)].stop();
      }
    }
  }
  if (crossing && round >= kPointRounds && round < kLocalRounds) zones_.apply(bodies);
  return crossing;
}

// What is held back may bring others to cross, which it went along with: rounds until nothing does. The way is examined
// again in each: a handle that turns does not end on the straight way to where it would have been.
double ContactStage::limitMotion(const MovingBodies& bodies, const ContactInput& input) {
  if (!set_.crossing) return 1.0;
  double least = 1.0;
  std::vector<double> whole;
  for (int b = 0; b < bodies.size(); ++b) whole.push_back(bodies[b].motion());
  for (int round = 0; round <= kLimitRounds; ++round) {
    for (int b = 0; b < bodies.size(); ++b) {
      bodies[b].endPositions(x_end_[b]);
      input.surfaces.setEnd(bodies.index(b), x_end_[b]);
    }
    candidates_.clear();
    findOnSurfaces(input, std::numeric_limits<double>::infinity());
    stopAtPlanes(bodies, input);
    if (!holdBackCrossing(bodies, round)) break;
  }
  for (int b = 0; b < bodies.size(); ++b) {
    if (whole[b] > 0) least = std::min(least, bodies[b].motion() / whole[b]);
  }
  return least;
}

}  // namespace palpate
