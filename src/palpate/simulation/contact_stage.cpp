#include "palpate/simulation/contact_stage.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "palpate/common/parallel.h"

namespace palpate {
namespace {

constexpr double kNegligible = 1e-16;  // m/s of residual, where everything is as good as at rest
constexpr double kFarOff = 0.1;        // thicknesses that a residual may mean in a step
constexpr double kDeep = 0.5;          // thicknesses below a plane at which a motion is cut short
constexpr double kLargestArc = 5.0;    // thicknesses by which a gap is corrected for the handle's turning

}  // namespace

int ContactSet::active() const { return static_cast<int>(contacts.size()) - count(ContactState::open); }

int ContactSet::count(ContactState state) const {
  return static_cast<int>(
      std::count_if(status.begin(), status.end(), [&](const ContactStatus& s) { return s.state == state; }));
}

VecX ContactSet::rowVelocity(const ContactIsland& of) const {
  VecX lambda(static_cast<Eigen::Index>(3 * of.contacts.size())), w(lambda.size());
  for (std::size_t k = 0; k < of.contacts.size(); ++k) {
    lambda.segment<3>(static_cast<Eigen::Index>(3 * k)) = impulse.segment<3>(3 * of.contacts[k]);
    w.segment<3>(static_cast<Eigen::Index>(3 * k)) = free.segment<3>(3 * of.contacts[k]);
  }
  w.noalias() += of.delassus * lambda;
  return w;
}

VecX ContactSet::rowVelocity() const {
  VecX all(free.size());
  for (const ContactIsland& of : islands) {
    const VecX own = rowVelocity(of);
    for (std::size_t k = 0; k < of.contacts.size(); ++k) {
      all.segment<3>(3 * of.contacts[k]) = own.segment<3>(static_cast<Eigen::Index>(3 * k));
    }
  }
  return all;
}

// Place of a point's body among those that move, or -1.
int ContactStage::slot(const ContactPoint& point) const {
  return point.body >= 0 && point.body < static_cast<int>(slot_.size()) ? slot_[point.body] : -1;
}

// For each body that moves the contacts in which it takes part, increasing.
void ContactStage::listByBody(const std::vector<Contact>& contacts, Lists& lists) const {
  for (auto& list : lists) list.clear();
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const int first = slot(contacts[i].first), second = slot(contacts[i].second);
    if (first >= 0) lists[first].push_back(static_cast<int>(i));
    if (second >= 0 && second != first) lists[second].push_back(static_cast<int>(i));
  }
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
  findOnPlanes(bodies, indices, input, input.settings.margin);
  if (input.surfaces.active()) {
    input.surfaces.findOverlapping(input.settings, input.friction, candidates_);
    for (const Contact& c : near_) input.surfaces.follow(c, input.settings, input.friction, candidates_);
  }
  followEarlier(bodies, input);
  correctForTurning(bodies, kLargestArc * input.settings.thickness);
  set_.candidates = static_cast<int>(candidates_.size());
}

// Everything along the motion to the present end velocities.
void ContactStage::search(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                          const ContactInput& input) {
  findOnPlanes(bodies, indices, input, 0.0);
  if (input.surfaces.active()) {
    input.surfaces.find(input.settings, input.friction, candidates_);
  }
  correctForTurning(bodies, kLargestArc * input.settings.thickness);
}

// The handle's nodes go round on arcs, their velocity rows straight on: what an arc ends beside the straight line is
// known once the motion is predicted, and belongs to the gap. Within bounds: a wild prediction must not make wild gaps.
void ContactStage::correctForTurning(const std::vector<Body*>& bodies, double bound) {
  const bool framed = std::any_of(bodies.begin(), bodies.end(), [](const Body* b) { return b->framed(); });
  if (!framed) return;
  for (Contact& c : candidates_) {
    const auto offset = [&](const ContactPoint& point) {
      const int b = slot(point);
      if (b < 0 || !bodies[b]->framed()) return 0.0;
      return std::clamp(c.normal.dot(bodies[b]->arcOffset(point, x_end_[b])), -bound, bound);
    };
    c.gap += offset(c.first) - offset(c.second);
  }
}

// Contact on a node that is not ordered last needs a new factor; rare, as nodes near others are ordered last
// beforehand. Those of all candidates then come too, so that the order lasts.
bool ContactStage::prepareNodes(const std::vector<Body*>& bodies, const std::vector<int>& indices) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = *bodies[b];
    bool missing = false;
    for (const int i : own_[b]) {
      const Contact& c = set_.contacts[i];
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

// Takes an island's matrix and report over from the pass before if it is the same and was solved; false if not.
bool ContactStage::keepIsland(ContactIsland& island) {
  if (set_.passes == 1) return false;
  for (const int i : island.contacts) {
    if (changed_[i]) return false;
  }
  ContactIsland& before = old_[set_.island[island.contacts.front()]];
  if (!before.solver.converged || before.contacts != island.contacts) return false;
  island.delassus.swap(before.delassus);
  island.solver = before.solver;
  island.solver.iterations = 0;
  return true;
}

// Bodies are joined by the contacts that they share.
void ContactStage::findIslands() {
  const std::size_t m = set_.contacts.size();
  root_.resize(own_.size());
  std::iota(root_.begin(), root_.end(), 0);
  const auto rootOf = [&](int b) {
    while (root_[b] != b) b = root_[b] = root_[root_[b]];
    return b;
  };
  for (const Contact& c : set_.contacts) {
    const int first = slot(c.first), second = slot(c.second);
    if (first < 0 || second < 0) continue;
    const int a = rootOf(first), b = rootOf(second);
    root_[std::max(a, b)] = std::min(a, b);
  }
  old_.swap(set_.islands);
  of_root_.assign(own_.size(), -1);
  island_.resize(m);
  set_.place.resize(m);
  std::size_t count = 0;
  const auto begin = [&] {
    if (set_.islands.size() == count) set_.islands.emplace_back();
    set_.islands[count].contacts.clear();
    set_.islands[count].bodies.clear();
    return static_cast<int>(count++);
  };
  for (std::size_t i = 0; i < m; ++i) {
    const Contact& c = set_.contacts[i];
    const int body = std::max(slot(c.first), slot(c.second));
    int island = -1;
    if (body < 0) {
      island = begin();  // both stand still
    } else {
      int& known = of_root_[rootOf(body)];
      if (known < 0) known = begin();
      island = known;
    }
    island_[i] = island;
    set_.place[i] = static_cast<int>(set_.islands[island].contacts.size());
    set_.islands[island].contacts.push_back(static_cast<int>(i));
  }
  for (std::size_t b = 0; b < own_.size(); ++b) {
    const int island = of_root_[rootOf(static_cast<int>(b))];
    if (island >= 0) set_.islands[island].bodies.push_back(static_cast<int>(b));
  }
  set_.islands.resize(count);
  kept_islands_.assign(count, 0);
  for (std::size_t k = 0; k < count; ++k) kept_islands_[k] = keepIsland(set_.islands[k]) ? 1 : 0;
  set_.island.swap(island_);
}

// Impulses and states of contacts that are new in this pass, from the step before.
void ContactStage::warmStart(double h) {
  const auto m = static_cast<Eigen::Index>(set_.contacts.size());
  const Eigen::Index known = set_.impulse.size() / 3;
  set_.impulse.conservativeResize(3 * m);
  set_.status.resize(set_.contacts.size());
  for (Eigen::Index i = known; i < m; ++i) {
    const Contact& c = set_.contacts[i];
    set_.impulse.segment<3>(3 * i).setZero();
    set_.status[i] = {};
    const auto at = std::lower_bound(memory_.begin(), memory_.end(), c.track,
                                     [](const Memory& a, std::uint64_t track) { return a.track < track; });
    if (at != memory_.end() && at->track == c.track) {
      set_.impulse.segment<3>(3 * i) = h * (c.frame() * at->force);
      set_.status[i] = at->status;
    }
  }
}

/// @param scale  largest velocity of all islands: what counts as solved does not depend on how they fall apart [m/s]
void ContactStage::solveIsland(std::size_t index, double h, double scale, const ContactSettings& settings) {
  ContactIsland& island = set_.islands[index];
  const auto m = static_cast<Eigen::Index>(island.contacts.size());
  formDelassus(island);
  IslandSolver& own = solvers_[index];
  for (VecX* rows : {&own.free, &own.impulse}) rows->resize(3 * m);
  for (VecX* each : {&own.bias, &own.friction}) each->resize(m);
  own.status.resize(island.contacts.size());
  for (Eigen::Index k = 0; k < m; ++k) {
    const int i = island.contacts[k];
    own.free.segment<3>(3 * k) = set_.free.segment<3>(3 * i);
    own.impulse.segment<3>(3 * k) = set_.impulse.segment<3>(3 * i);
    own.bias[k] = -set_.contacts[i].gap / h;
    own.friction[k] = set_.contacts[i].friction;
    own.status[k] = set_.status[i];
  }
  const double largest = std::max(own.free.lpNorm<Eigen::Infinity>(), own.bias.lpNorm<Eigen::Infinity>());
  if (largest == 0 || island.delassus.isZero(0.0)) {  // nothing moves towards anything, or nothing can move
    own.impulse.setZero();
    own.status.assign(island.contacts.size(), {});
    island.solver = {true, 0, 0.0};
  } else {
    ContactSolverSettings solver = settings.solver;
    if (std::isfinite(scale)) {
      solver.tolerance *= scale / largest;
      solver.acceptable *= scale / largest;
    }
    solver.tolerance = std::max(solver.tolerance, kNegligible / largest);
    const ContactProblem problem{island.delassus, own.free, own.bias, own.friction, settings.cone};
    island.solver = own.solver.solve(problem, solver, own.impulse, own.status);
  }
  for (Eigen::Index k = 0; k < m; ++k) {
    set_.impulse.segment<3>(3 * island.contacts[k]) = own.impulse.segment<3>(3 * k);
    set_.status[island.contacts[k]] = own.status[k];
  }
}

// At the same time, unless one is most of the work: its own loops are shared out then.
void ContactStage::solveIslands(double h, double scale, const ContactSettings& settings) {
  constexpr double kMost = 0.7;
  double work = 0, most = 0;
  for (std::size_t k = 0; k < set_.islands.size(); ++k) {
    if (kept_islands_[k]) continue;
    const double own = static_cast<double>(set_.islands[k].contacts.size());
    work += own * own * own;
    most = std::max(most, own * own * own);
  }
  const auto solve = [&](int k) {
    if (!kept_islands_[k]) solveIsland(static_cast<std::size_t>(k), h, scale, settings);
  };
  const int count = static_cast<int>(set_.islands.size());
  if (most > kMost * work) {
    for (int k = 0; k < count; ++k) solve(k);
  } else {
    parallelFor(count, solve);
  }
}

// Sum over the island's bodies, with both triangles.
void ContactStage::formDelassus(ContactIsland& island) {
  const auto rows = static_cast<Eigen::Index>(3 * island.contacts.size());
  MatX& w = island.delassus;
  const bool alone = island.bodies.size() == 1;
  if (alone) {
    w.resize(rows, rows);
  } else {
    w.setZero(rows, rows);
  }
  for (const int b : island.bodies) {
    const Body::ContactRows& own = set_.rows[b];
    if (alone) break;
    for (std::size_t j = 0; j < own.contacts.size(); ++j) {
      for (std::size_t i = j; i < own.contacts.size(); ++i) {
        w.block<3, 3>(3 * set_.place[own.contacts[i]], 3 * set_.place[own.contacts[j]]) +=
            own.delassus.block<3, 3>(static_cast<Eigen::Index>(3 * i), static_cast<Eigen::Index>(3 * j));
      }
    }
  }
  // in tiles that stay in the cache
  constexpr Eigen::Index kTile = 32;
  parallelFor(static_cast<int>((rows + kTile - 1) / kTile), [&](int tile) {
    const Eigen::Index j = tile * kTile, width = std::min(kTile, rows - j);
    if (alone) w.block(j, j, rows - j, width) = set_.rows[island.bodies.front()].delassus.block(j, j, rows - j, width);
    auto diagonal = w.block(j, j, width, width);
    for (Eigen::Index c = 0; c < width; ++c) {
      for (Eigen::Index r = c + 1; r < width; ++r) diagonal(c, r) = diagonal(r, c);
    }
    for (Eigen::Index i = j + width; i < rows; i += kTile) {
      const Eigen::Index height = std::min(kTile, rows - i);
      w.block(j, i, width, height) = w.block(i, j, height, width).transpose();
    }
  });
}

void ContactStage::solveOnce(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                             const ContactSettings& settings) {
  const double h = bodies.front()->input().step;
  for (std::size_t b = 0; b < bodies.size(); ++b) set_.rows[b].contacts = own_[b];
  findIslands();
  set_.free.setZero(static_cast<Eigen::Index>(3 * set_.contacts.size()));
  forEachBody(bodies, [&](int b) { bodies[b]->contactRows(set_.contacts, indices[b], changed_, set_.rows[b]); });
  for (std::size_t b = 0; b < bodies.size(); ++b) {  // in this order: bodies share contacts
    bodies[b]->addFreeRowVelocity(set_.contacts, own_[b], indices[b], set_.free);
  }
  warmStart(h);
  double scale = set_.free.lpNorm<Eigen::Infinity>();
  for (const Contact& c : set_.contacts) scale = std::max(scale, std::abs(c.gap) / h);
  if (solvers_.size() < set_.islands.size()) solvers_.resize(set_.islands.size());
  set_.solver = {true, 0, 0.0};
  solveIslands(h, scale, settings);
  for (const ContactIsland& island : set_.islands) {
    const ContactSolverReport& report = island.solver;
    set_.solver.converged = set_.solver.converged && report.converged;
    set_.solver.iterations = std::max(set_.solver.iterations, report.iterations);
    set_.solver.residual = std::max(set_.solver.residual, report.residual);
  }
  forEachBody(bodies, [&](int b) {
    const bool kept = !own_[b].empty() && kept_islands_[set_.island[own_[b].front()]];
    if (!kept) bodies[b]->applyImpulse(set_.contacts, set_.rows[b], indices[b], set_.impulse);
  });
}

// The deepest violated point of each patch; a contact that is there already is linearized anew where it now is.
bool ContactStage::addViolated() {
  std::sort(candidates_.begin(), candidates_.end(), [](const Contact& a, const Contact& b) {
    return std::tuple(a.first.body, a.partner, a.patch, a.end_gap, a.key) <
           std::tuple(b.first.body, b.partner, b.patch, b.end_gap, b.key);
  });
  changed_.assign(set_.contacts.size(), 0);
  keys_.clear();
  for (std::size_t i = 0; i < set_.contacts.size(); ++i) keys_.emplace_back(set_.contacts[i].key, i);
  bool added = false;
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    const Contact& c = candidates_[i];
    if (!c.crosses() && !(c.end_gap < -c.slack)) continue;
    if (i > 0 && samePatch(candidates_[i - 1], c) && c.normal.dot(candidates_[i - 1].normal) > 0.7) continue;
    if (!added) std::sort(keys_.begin(), keys_.end());
    added = true;
    const auto same = std::lower_bound(keys_.begin(), keys_.end(), std::pair(c.key, 0));
    if (same != keys_.end() && same->first == c.key) {
      set_.contacts[same->second] = c;
      changed_[same->second] = 1;
    } else {
      keys_.insert(same, {c.key, static_cast<int>(set_.contacts.size())});
      set_.contacts.push_back(c);
      changed_.push_back(1);
    }
  }
  return added;
}

// Where the bodies will be if the contacts of the step before go on as they were: a far better guess than free motion,
// in which a body at rest falls a centimeter in a step of 33 ms and all of its lower side would be a candidate.
void ContactStage::predict(const std::vector<Body*>& bodies, const std::vector<int>& indices) {
  if (earlier_.empty()) return;
  earlier_impulse_ = earlier_force_ * bodies.front()->input().step;
  listByBody(earlier_, earlier_own_);
  forEachBody(bodies, [&](int b) { bodies[b]->predict(earlier_, earlier_own_[b], indices[b], earlier_impulse_); });
}

// What carried force on a plane in the step before is a candidate wherever the prediction puts it.
void ContactStage::followEarlier(const std::vector<Body*>& bodies, const ContactInput& input) {
  found_.clear();
  for (const Contact& c : candidates_) found_.push_back(c.key);
  std::sort(found_.begin(), found_.end());
  for (const Contact& c : earlier_) {
    if (c.partner >= static_cast<int>(input.obstacles.size())) continue;
    if (std::binary_search(found_.begin(), found_.end(), c.key)) continue;
    const int b = slot(c.first);
    if (b < 0) continue;
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
    if (!c.crosses() && c.end_gap < input.settings.margin) keep(c);
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
  if (!settings.reduction) {
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
  set_.bodies = indices;
  set_.rows.resize(bodies.size());
  for (Body::ContactRows& rows : set_.rows) {
    rows.contacts.clear();
    rows.known = 0;
  }
  set_.island.clear();
  slot_.clear();
  for (std::size_t b = 0; b < indices.size(); ++b) {
    if (static_cast<int>(slot_.size()) <= indices[b]) slot_.resize(indices[b] + 1, -1);
    slot_[indices[b]] = static_cast<int>(b);
  }
  own_.resize(bodies.size());
  earlier_own_.resize(bodies.size());
  set_.solver = {true, 0, 0.0};
  set_.passes = 0;
  set_.candidates = 0;
  set_.penetration = 0;
  set_.crossing = false;
  if (bodies.empty()) {
    set_.islands.clear();
    return true;
  }
  const double h = bodies.front()->input().step;
  predict(bodies, indices);
  propose(bodies, indices, input);
  chooseContacts(bodies, settings);
  changed_.assign(set_.contacts.size(), 1);
  if (set_.contacts.empty()) {  // what was touched is out of reach: its impulses are, too
    for (Body* b : bodies) b->applyImpulse({}, {}, -1, VecX());
  }
  int iterations = 0;
  for (;;) {
    if (!set_.contacts.empty()) {
      ++set_.passes;
      capRecovery(h, settings.max_recovery_speed);
      listByBody(set_.contacts, own_);
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
  if (set_.contacts.empty()) set_.islands.clear();
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
  std::vector<double> next;
  for (int round = 0; round <= kRounds; ++round) {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      bodies[b]->endPositions(x_end_[b], share[b]);
      input.surfaces.setEnd(indices[b], x_end_[b]);
    }
    candidates_.clear();
    input.surfaces.find(input.settings, input.friction, candidates_);
    stopAtPlanes(bodies, indices, input);
    next = share;
    bool crossing = false;
    for (const Contact& c : candidates_) {
      if (!c.crosses()) continue;
      crossing = true;
      double factor = round < kPatient ? c.impact_time : 0.5 * c.impact_time;
      if (round == kRounds) factor = 0;
      for (const ContactPoint* point : {&c.first, &c.second}) {
        const int b = slot(*point);
        if (b < 0) continue;
        next[b] = std::min(next[b], factor * share[b]);
      }
    }
    if (!crossing) return;
    share = next;
  }
}

}  // namespace palpate
