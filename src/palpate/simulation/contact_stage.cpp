#include "palpate/simulation/contact_stage.h"

#include <algorithm>
#include <tuple>

namespace palpate {

int ContactSet::active() const { return static_cast<int>(contacts.size()) - count(ContactState::open); }

int ContactSet::count(ContactState state) const {
  return static_cast<int>(
      std::count_if(status.begin(), status.end(), [&](const ContactStatus& s) { return s.state == state; }));
}

void ContactStage::find(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                        const std::vector<Obstacle>& obstacles, double reach, bool linearize_at_end) {
  candidates_.clear();
  x_end_.resize(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    bodies[b]->endPositions(x_end_[b]);
    bodies[b]->contactFinder().find(indices[b], bodies[b]->startPositions(), x_end_[b], obstacles, reach,
                                    linearize_at_end, candidates_);
  }
}

// Contact on a node that is not ordered last needs a new factor; rare, as nodes near obstacles are ordered last
// beforehand.
bool ContactStage::prepareNodes(const std::vector<Body*>& bodies, const std::vector<int>& indices) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    std::vector<int> nodes = bodies[b]->contactNodes();
    std::vector<char> listed(bodies[b]->nodes(), 0);
    for (const int n : nodes) listed[n] = 1;
    const std::size_t before = nodes.size();
    for (const Contact& c : set_.contacts) {
      for (const ContactPoint* point : {&c.first, &c.second}) {
        if (point->body != indices[b]) continue;
        for (const int n : point->node) {
          if (bodies[b]->row()[n] >= 0 && !listed[n]) nodes.push_back(n);
          listed[n] = 1;
        }
      }
    }
    if (nodes.size() == before) continue;
    bodies[b]->orderContactNodes(nodes);
    if (!bodies[b]->factorize()) return false;
    bodies[b]->solveFreeAgain();
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
    const auto at = std::lower_bound(memory_.begin(), memory_.end(), c.key,
                                     [](const Memory& a, std::int64_t key) { return a.key < key; });
    if (at != memory_.end() && at->key == c.key) {
      set_.impulse.segment<3>(3 * i) = h * (c.frame() * at->force);
      set_.status[i] = at->status;
    }
  }
  const ContactProblem problem{set_.delassus, set_.free, bias_, friction_, settings.cone};
  set_.solver = solver_.solve(problem, settings.solver, set_.impulse, set_.status);
  for (std::size_t b = 0; b < bodies.size(); ++b) bodies[b]->applyImpulse(set_.rows[b], set_.impulse);
}

// The deepest violated vertex of each patch; a contact that is there already is linearized anew where it now is.
bool ContactStage::addViolated(const ContactSettings& settings) {
  std::sort(candidates_.begin(), candidates_.end(), [](const Contact& a, const Contact& b) {
    return std::tuple(a.partner, a.patch, a.end_gap, a.key) < std::tuple(b.partner, b.patch, b.end_gap, b.key);
  });
  bool added = false;
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    const Contact& c = candidates_[i];
    if (!(c.end_gap < -settings.penetration_tolerance)) continue;
    if (i > 0 && candidates_[i - 1].partner == c.partner && candidates_[i - 1].patch == c.patch) continue;
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

// What carried force in the step before is a candidate wherever the prediction puts it.
void ContactStage::followEarlier(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                                 const std::vector<Obstacle>& obstacles) {
  std::vector<std::int64_t> found;
  found.reserve(candidates_.size());
  for (const Contact& c : candidates_) found.push_back(c.key);
  std::sort(found.begin(), found.end());
  for (const Contact& c : earlier_) {
    if (std::binary_search(found.begin(), found.end(), c.key)) continue;
    const auto at = std::find(indices.begin(), indices.end(), c.first.body);
    const auto b = static_cast<std::size_t>(at - indices.begin());
    candidates_.push_back(bodies[b]->contactFinder().follow(c, bodies[b]->startPositions(), x_end_[b], obstacles));
  }
}

void ContactStage::remember(double h) {
  memory_.clear();
  kept_keys_.clear();
  earlier_.clear();
  earlier_force_.resize(static_cast<Eigen::Index>(3 * set_.active()));
  for (std::size_t i = 0; i < set_.contacts.size(); ++i) {
    if (set_.status[i].state == ContactState::open) continue;
    const Contact& c = set_.contacts[i];
    const auto impulse = set_.impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
    memory_.push_back({c.key, c.frame().transpose() * impulse / h, set_.status[i]});
    earlier_force_.segment<3>(static_cast<Eigen::Index>(3 * earlier_.size())) = impulse / h;
    earlier_.push_back(c);
  }
  std::sort(memory_.begin(), memory_.end(), [](const Memory& a, const Memory& b) { return a.key < b.key; });
  for (const Memory& m : memory_) kept_keys_.push_back(m.key);
}

bool ContactStage::solve(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                         const std::vector<Obstacle>& obstacles, const ContactSettings& settings) {
  set_.contacts.clear();
  set_.impulse.resize(0);
  set_.status.clear();
  set_.rows.clear();
  set_.solver = {true, 0, 0.0};
  set_.passes = 0;
  predict(bodies, indices);
  find(bodies, indices, obstacles, settings.reach, false);
  followEarlier(bodies, indices, obstacles);
  set_.candidates = static_cast<int>(candidates_.size());
  set_.penetration = 0;
  if (settings.reduce) {
    double spacing = bodies.front()->contactFinder().edgeLength();
    for (const Body* b : bodies) spacing = std::min(spacing, b->contactFinder().edgeLength());
    for (const int i : reduceContacts(candidates_, kept_keys_, settings.spacing * spacing)) {
      set_.contacts.push_back(candidates_[i]);
    }
  } else {
    set_.contacts = candidates_;
  }
  int iterations = 0;
  while (!set_.contacts.empty()) {
    ++set_.passes;
    if (!prepareNodes(bodies, indices)) {
      set_ = ContactSet{};
      return false;
    }
    solveOnce(bodies, indices, settings);
    iterations += set_.solver.iterations;
    find(bodies, indices, obstacles, 0.0, true);
    set_.penetration = 0;
    for (const Contact& c : candidates_) set_.penetration = std::max(set_.penetration, -c.end_gap);
    if (set_.passes >= settings.max_passes || !addViolated(settings)) break;
  }
  set_.solver.iterations = iterations;
  remember(bodies.front()->input().step);
  return true;
}

}  // namespace palpate
