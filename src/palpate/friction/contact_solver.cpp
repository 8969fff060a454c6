#include "palpate/friction/contact_solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "palpate/friction/single_contact.h"

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;
using MapX = Eigen::Map<MatX>;

// Proximal shift relative to rho: where it starts, far from the solution and near it, and its change after a problem
// solved and after one that was not.
constexpr double kFirstShift = 1e-2;
constexpr double kFirstShiftNear = 1e-3;
constexpr double kShiftDown = 0.5;
constexpr double kShiftUp = 5.0;
// Interior-point iterations: at most, in number and as a part of the work that is left; fewer than `least` are not
// worth a start; so many without a gain end them.
constexpr int kMostInterior = 60;
constexpr double kPartInterior = 0.5;
constexpr int kLeastInterior = 12;
constexpr int kIdleInterior = 10;
constexpr Eigen::Index kFewContacts = 12;  // solved as a whole
constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

void ContactSolver::prepare(const ContactProblem& problem, double mean_scale) {
  const Eigen::Index m = problem.bias.size();
  rho_.resize(m);
  for (Eigen::Index i = 0; i < m; ++i) {
    const double own = impulseScale(problem, i);
    rho_[i] = own > 0.0 ? own : mean_scale;
  }
  heading_.assign(static_cast<std::size_t>(m), Vec2(1.0, 0.0));
  const std::size_t facets = problem.cone.exact ? 0 : static_cast<std::size_t>(problem.cone.facets);
  if (corner_.size() == facets) return;
  corner_.resize(facets);
  normal_.resize(facets);
  tangent_.resize(facets);
  for (std::size_t k = 0; k < facets; ++k) {
    corner_[k] = vertexDirection(static_cast<int>(k), problem.cone.facets).tail<2>();
    normal_[k] = edgeNormal(static_cast<int>(k), problem.cone.facets).tail<2>();
    tangent_[k] = edgeTangent(static_cast<int>(k), problem.cone.facets).tail<2>();
  }
}

void ContactSolver::updateVelocity(const ContactProblem& problem, const VecX& lambda, VecX& w) {
  contactVelocity(problem, lambda, part_velocity_, w);
}

/// After some impulses have changed from what they were when w_ was theirs.
void ContactSolver::updateVelocitySince(const ContactProblem& problem, const VecX& before) {
  const auto changed = [&](Eigen::Index i) { return lambda_.segment<3>(3 * i) != before.segment<3>(3 * i); };
  Eigen::Index count = 0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) count += changed(i) ? 1 : 0;
  if (4 * count > rho_.size() || !lambda_.allFinite()) {
    updateVelocity(problem, lambda_, w_);
    return;
  }
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    if (!changed(i)) continue;
    const Vec3 change = lambda_.segment<3>(3 * i) - before.segment<3>(3 * i);
    w_.noalias() += problem.delassus.middleCols<3>(3 * i) * change;
  }
}

/// Nearest point of the cross-section of the given radius, and the state that it means.
ContactStatus ContactSolver::nearest(const FrictionCone& cone, double radius, const Vec2& p, Vec2& point) const {
  if (cone.exact) {
    const double length = p.norm();
    point = length < radius ? p : Vec2(length > 0.0 ? Vec2(radius / length * p) : Vec2::Zero());
    return {length < radius ? ContactState::stick : ContactState::slide, 0};
  }
  const double sector = 2.0 * std::numbers::pi / cone.facets;
  int k = 0;  // the edge in whose sector p is
  double farthest = p.dot(normal_[0]);
  for (int edge = 1; edge < cone.facets; ++edge) {
    const double out = p.dot(normal_[edge]);
    if (out > farthest) {
      farthest = out;
      k = edge;
    }
  }
  const double apothem = radius * std::cos(0.5 * sector), half = radius * std::sin(0.5 * sector);
  if (p.dot(normal_[k]) < apothem) {
    point = p;
    return {ContactState::stick, 0};
  }
  const double along = p.dot(tangent_[k]);
  if (std::abs(along) < half) {
    point = apothem * normal_[k] + along * tangent_[k];
    return {ContactState::edge, k};
  }
  const int vertex = wrapped(along > 0.0 ? k + 1 : k, cone.facets);
  point = radius * corner_[vertex];
  return {ContactState::vertex, vertex};
}

double ContactSolver::residual(const ContactProblem& problem) const {
  double worst = 0.0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    const Vec3 impulse = rho_[i] * lambda_.segment<3>(3 * i);
    worst = std::max(worst, std::abs(std::min(impulse[0], w_[3 * i] - problem.bias[i])));
    const double radius = problem.friction[i] * std::max(0.0, impulse[0]);
    Vec2 point;
    nearest(problem.cone, radius, impulse.tail<2>() - w_.segment<2>(3 * i + 1), point);
    worst = std::max(worst, (impulse.tail<2>() - point).norm());
    if (!std::isfinite(impulse.sum())) return kInfinity;
  }
  return worst;
}

/// rho lambda - w with w_n less its bias, as in the nonsmooth Newton method of Alart and Curnier.
Vec3 ContactSolver::augmented(const ContactProblem& problem, Eigen::Index i) const {
  Vec3 out = rho_[i] * lambda_.segment<3>(3 * i) - w_.segment<3>(3 * i);
  out[0] += problem.bias[i];
  return out;
}

/// States from the augmented impulses.
void ContactSolver::classify(const ContactProblem& problem) {
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    const Vec3 impulse = augmented(problem, i);
    if (impulse[0] <= 0.0) {
      status_[i] = {};
    } else if (problem.friction[i] == 0.0) {
      status_[i] = {ContactState::slide, 0};
    } else {
      Vec2 point;
      status_[i] = nearest(problem.cone, problem.friction[i] * impulse[0], impulse.tail<2>(), point);
      if (point.squaredNorm() > 0.0) heading_[i] = point.normalized();
    }
  }
}

/// Contacts that slid and slide go no farther than to the next edge or vertex: an edge's solution that ends beyond its
/// vertex says that the vertex comes next, but not, as rho is only a guess of the compliance, what comes after it.
void ContactSolver::walk(const FrictionCone& cone, const std::vector<ContactStatus>& before) {
  if (cone.exact) return;
  const auto polygonal = [](const ContactStatus& s) {
    return s.state == ContactState::edge || s.state == ContactState::vertex;
  };
  const auto place = [](const ContactStatus& s) { return 2 * s.index + (s.state == ContactState::edge ? 1 : 0); };
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (!polygonal(before[i]) || !polygonal(status_[i])) continue;
    const int turn = wrapped(place(status_[i]) - place(before[i]) + cone.facets, 2 * cone.facets) - cone.facets;
    if (std::abs(turn) < 2 || 2 * std::abs(turn) > cone.facets) continue;
    const int next = wrapped(place(before[i]) + (turn > 0 ? 1 : -1), 2 * cone.facets);
    status_[i] = {next % 2 == 1 ? ContactState::edge : ContactState::vertex, next / 2};
  }
}

/// Makes lambda obey its states exactly: no pull, inside the cone, on the edge or vertex that the state names. A state
/// that rounding has carried across its border becomes its neighbor.
void ContactSolver::settleStates(const ContactProblem& problem) {
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    auto impulse = lambda_.segment<3>(3 * i);
    if (status_[i].state == ContactState::open || !(impulse[0] > 0.0)) {
      impulse.setZero();
      status_[i] = {};
      continue;
    }
    const double radius = problem.friction[i] * impulse[0];
    if (problem.friction[i] == 0.0) {
      impulse.tail<2>().setZero();
      status_[i] = {ContactState::slide, 0};
      continue;
    }
    bool fits = status_[i].state != ContactState::stick;
    if (status_[i].state == ContactState::edge) {
      const double half = radius * std::sin(std::numbers::pi / problem.cone.facets);
      fits = std::abs(impulse.tail<2>().dot(tangent_[status_[i].index])) < half;
    }
    if (fits) continue;
    Vec2 point;
    status_[i] = nearest(problem.cone, radius, impulse.tail<2>(), point);
    impulse.tail<2>() = point;
  }
}

/// One Gauss-Seidel sweep: every contact in turn solved exactly, the others held.
void ContactSolver::sweep(const ContactProblem& problem) {
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    const Vec3 before = lambda_.segment<3>(3 * i);
    SingleContact local;
    local.matrix = problem.delassus.block<3, 3>(3 * i, 3 * i);
    local.mu = problem.friction[i];
    local.free = w_.segment<3>(3 * i) - local.matrix * before;
    local.free[0] -= problem.bias[i];
    Vec3 after = Vec3::Zero();
    ContactStatus& status = status_[i];
    const int hint = status.index;
    if (local.free[0] >= 0.0 || local.matrix(0, 0) <= 1e-14 * rho_[i]) {
      status = {};
    } else if (local.mu == 0.0) {
      after[0] = -local.free[0] / local.matrix(0, 0);
      status = {ContactState::slide, 0};
    } else {
      local.eliminateNormal();
      after = local.impulse(solve2(local.schur, 0.0, -local.velocity));
      Vec2 point;
      if (after[0] > 0.0 &&
          nearest(problem.cone, local.mu * after[0], after.tail<2>(), point).state == ContactState::stick) {
        status = {ContactState::stick, 0};
      } else if (problem.cone.exact) {
        after = slideOnRoundCone(local);
        status = {ContactState::slide, 0};
        if (after.tail<2>().squaredNorm() > 0.0) heading_[i] = after.tail<2>().normalized();
      } else {
        PolygonSlide slide{local, corner_, normal_, tangent_, problem.cone.facets, 1e-13 * local.free.norm()};
        slide.search(hint);
        after = slide.lambda;
        status = slide.status;
      }
    }
    const Vec3 change = after - before;
    if (!change.allFinite() || change.isZero(0.0)) continue;
    lambda_.segment<3>(3 * i) = after;
    w_.noalias() += problem.delassus.middleCols<3>(3 * i) * change;
  }
}

/// Keeps lambda as the best so far if it is; returns its residual.
double ContactSolver::keepBest(const ContactProblem& problem, Best& best) {
  const double now = residual(problem);
  if (now < best.residual) {
    best.residual = now;
    best.lambda = lambda_;
    best.status = status_;
  }
  return now;
}

void ContactSolver::goTo(const ContactProblem& problem, const Best& best) {
  lambda_ = best.lambda;
  status_ = best.status;
  settleStates(problem);
  updateVelocity(problem, lambda_, w_);
}

/// Newton steps from state to state while they help.
/// @param patience  so many in a row without a gain end them
void ContactSolver::newtonPhase(const ContactProblem& problem, double tolerance, Best& best, int steps, Work& work,
                                int patience) {
  double phase_best = kInfinity;
  int stalled = 0;
  for (int k = 0; k < steps && work.left(); ++k) {
    work.spend(6.0 * work.product);
    if (!newton(problem, tolerance, work)) return;
    const double now = keepBest(problem, best);
    if (now <= tolerance) return;
    stalled = now < 0.9 * phase_best ? 0 : stalled + 1;
    phase_best = std::min(phase_best, now);
    if (stalled >= patience) return;
    before_ = status_;
    classify(problem);
    if (stalled > 0) walk(problem.cone, before_);
  }
}

/// Rounds of sweeps (their number doubles) and Newton steps, from `best`.
bool ContactSolver::alternate(const ContactProblem& problem, double tolerance, Best& best, int rounds, Work& work) {
  int sweeps = 4;
  swept_ = best;
  for (int round = 0; round < rounds && best.residual > tolerance && work.left(); ++round) {
    // go on from the sweeps' own end unless Newton got further
    goTo(problem, best.residual < swept_.residual ? best : swept_);
    for (int k = 0; k < sweeps && work.left(); ++k) {
      work.spend(2.0 * work.product);
      sweep(problem);
    }
    updateVelocity(problem, lambda_, w_);
    swept_.residual = kInfinity;
    keepBest(problem, swept_);
    keepBest(problem, best);
    if (best.residual <= tolerance) break;
    newtonPhase(problem, tolerance, best, 20, work);
    sweeps = std::min(2 * sweeps, 256);
  }
  return best.residual <= tolerance;
}

/// Proximal point iteration: problems with W + shift rho and free - shift rho center, whose solutions are unique where
/// redundant contacts leave those of the problem itself undetermined; each one's center is the solution of the one
/// before.
void ContactSolver::proximal(const ContactProblem& problem, double tolerance, Best& best, Work& work) {
  const Eigen::Index rows = problem.free.size();
  grow(shifted_matrix_, rows * rows);
  MapX shifted(shifted_matrix_.data(), rows, rows);
  shifted = problem.delassus;
  const double speed = std::max(problem.free.lpNorm<Eigen::Infinity>(), problem.bias.lpNorm<Eigen::Infinity>());
  double applied = 0.0;
  double shift = best.residual < 1e-3 * speed ? kFirstShiftNear : kFirstShift;
  center_ = best;
  while (best.residual > tolerance && work.left()) {
    shifted_free_ = problem.free;
    for (Eigen::Index i = 0; i < rho_.size(); ++i) {
      shifted.diagonal().segment<3>(3 * i).array() += (shift - applied) * rho_[i];
      shifted_free_.segment<3>(3 * i) -= shift * rho_[i] * center_.lambda.segment<3>(3 * i);
    }
    applied = shift;
    factor_.forget();
    const ContactProblem nearby{shifted, shifted_free_, problem.bias, problem.friction, problem.cone};
    goTo(nearby, center_);
    nearby_ = center_;
    nearby_.residual = residual(nearby);
    const double goal = std::max(0.01 * best.residual, tolerance);
    newtonPhase(nearby, goal, nearby_, 20, work);
    const bool solved = alternate(nearby, goal, nearby_, 5, work);
    goTo(problem, nearby_);
    center_.residual = kInfinity;
    keepBest(problem, center_);
    keepBest(problem, best);
    if (best.residual <= tolerance) return;
    newtonPhase(problem, tolerance, best, 4, work);
    shift = solved ? std::max(shift * kShiftDown, 1e-6) : std::min(shift * kShiftUp, 10.0);
  }
}

/// Interior-point iterations; what they come to is rounded to states. Newton steps on those now and then, and at the
/// end.
void ContactSolver::interior(const ContactProblem& problem, double tolerance, double acceptable, Best& best,
                             Work& work) {
  const double cost = InteriorPoint::cost(static_cast<double>(rho_.size())) + 3.0 * work.product;
  if (work.remaining() < kLeastInterior * cost) return;
  const double most = work.operations + std::max(kPartInterior * work.remaining(), kLeastInterior * cost);
  const double speed = std::max(problem.free.lpNorm<Eigen::Infinity>(), problem.bias.lpNorm<Eigen::Infinity>());
  interior_.start(problem, rho_, speed);
  double attempted = kInfinity, gained = kInfinity;
  int idle = 0;
  for (int k = 0; k < kMostInterior && idle < kIdleInterior && work.left() && work.operations < most; ++k) {
    work.spend(cost);
    if (!interior_.iterate(problem, rho_)) break;
    lambda_ = interior_.impulse();
    updateVelocity(problem, lambda_, w_);
    classify(problem);
    settleStates(problem);
    updateVelocity(problem, lambda_, w_);
    const double now = keepBest(problem, best);
    if (now <= acceptable) break;
    idle = now < 0.9 * gained ? 0 : idle + 1;
    gained = std::min(gained, now);
    if (now < 1e-4 * speed && now < 0.1 * attempted) {
      attempted = now;
      newtonPhase(problem, tolerance, best, 1, work);
      if (best.residual <= acceptable) return;
    }
  }
  if (best.residual <= tolerance) return;
  goTo(problem, best);
  newtonPhase(problem, tolerance, best, 4, work);
}

/// True if the states that came with a warm start can be used as they are.
bool ContactSolver::acceptHint(const ContactProblem& problem, const std::vector<ContactStatus>& hint) {
  if (hint.size() != status_.size()) return false;
  for (std::size_t i = 0; i < hint.size(); ++i) {
    const bool polygonal = hint[i].state == ContactState::edge || hint[i].state == ContactState::vertex;
    const bool round = hint[i].state == ContactState::slide;
    const bool rough = problem.friction[static_cast<Eigen::Index>(i)] > 0.0;
    if (polygonal && (problem.cone.exact || !rough || hint[i].index < 0 || hint[i].index >= problem.cone.facets))
      return false;
    if (round && rough && !problem.cone.exact) return false;
    if (hint[i].state == ContactState::stick && !rough) return false;
    const auto tangential = lambda_.segment<2>(3 * static_cast<Eigen::Index>(i) + 1);
    if (round && tangential.squaredNorm() > 0.0) heading_[i] = tangential.normalized();
  }
  status_ = hint;
  return true;
}

/// Takes from impulses that are no solution what would feed energy in: friction along its contact's velocity is
/// shortened or dropped, and all impulses are scaled back while together they do more work than the bias asks for.
void ContactSolver::makePassive(const ContactProblem& problem, double slack) {
  // Rounds that shorten come before those that drop: on coupled contacts they contract slowly, by a few contacts each,
  // but dropping friction spoils what was nearly solved. Their work is counted.
  constexpr int most_gentle = 5000;
  constexpr double most_operations = 2e9;
  constexpr double beyond = 1.5;  // over-relaxation, so that few rounds do
  double operations = 0.0;
  int gentle = most_gentle;
  for (int round = 0; round <= gentle + 10; ++round) {
    if (operations > most_operations && round < gentle) gentle = std::max(round, 200);
    bool changed = false;
    for (Eigen::Index i = 0; i < rho_.size(); ++i) {
      const Vec2 friction = lambda_.segment<2>(3 * i + 1);
      const double power = friction.dot(w_.segment<2>(3 * i + 1));
      if (friction.isZero(0.0) || (power <= slack * friction.norm() && round < gentle + 10)) continue;
      const double own = friction.dot(problem.delassus.block<2, 2>(3 * i + 1, 3 * i + 1) * friction);
      // with the share s of the friction its power is s (others + s own)
      const double share = own > 0.0 && round < gentle ? std::clamp(1.0 - beyond * power / own, 0.0, 1.0) : 0.0;
      lambda_.segment<2>(3 * i + 1) = share * friction;
      w_.noalias() += problem.delassus.middleCols<2>(3 * i + 1) * ((share - 1.0) * friction);
      status_[i] = {ContactState::stick, 0};
      operations += 12.0 * static_cast<double>(rho_.size());
      changed = true;
    }
    double allowed = 0.0;
    for (Eigen::Index i = 0; i < rho_.size(); ++i) allowed += lambda_[3 * i] * std::max(0.0, problem.bias[i]);
    const double linear = lambda_.dot(problem.free) - allowed, square = lambda_.dot(w_ - problem.free);
    if (linear + 0.5 * square > slack * lambda_.lpNorm<1>()) {
      const double share = square > 0.0 ? std::clamp(-linear / square, 0.0, 1.0) : 0.0;
      lambda_ *= share;
      updateVelocity(problem, lambda_, w_);
      if (share == 0.0) status_.assign(status_.size(), {});
      changed = true;
    }
    if (!changed) return;
  }
}

/// Connected components of W's pattern of blocks.
void ContactSolver::findParts(const ContactProblem& problem) {
  const int m = static_cast<int>(problem.bias.size());
  order_.clear();
  part_start_.clear();
  waiting_.resize(static_cast<std::size_t>(m));
  for (int i = 0; i < m; ++i) waiting_[i] = m - 1 - i;
  while (!waiting_.empty()) {
    std::size_t next = order_.size();
    part_start_.push_back(static_cast<int>(next));
    order_.push_back(waiting_.back());
    waiting_.pop_back();
    for (; next < order_.size(); ++next) {
      std::size_t kept = 0;
      for (const int j : waiting_) {
        if (problem.delassus.block<3, 3>(3 * j, 3 * order_[next]).isZero(0.0) &&
            problem.delassus.block<3, 3>(3 * order_[next], 3 * j).isZero(0.0)) {
          waiting_[kept++] = j;
        } else {
          order_.push_back(j);
        }
      }
      waiting_.resize(kept);
    }
    std::sort(order_.begin() + part_start_.back(), order_.end());
  }
  part_start_.push_back(m);
}

/// Solves the part of `whole` that the contacts make up, from and into their places in lambda and status.
ContactSolverReport ContactSolver::gatherAndSolve(const ContactProblem& whole, const int* contacts, int count,
                                                  const ContactSolverSettings& settings, double scale,
                                                  double mean_scale, VecX& lambda, std::vector<ContactStatus>& status) {
  grow(part_matrix_, 9 * count * count);
  MapX matrix(part_matrix_.data(), 3 * count, 3 * count);
  part_free_.resize(3 * count);
  part_lambda_.resize(3 * count);
  part_bias_.resize(count);
  part_friction_.resize(count);
  part_status_.resize(static_cast<std::size_t>(count));
  const std::span<const int> own(contacts, static_cast<std::size_t>(count));
  gatherBlocks(whole, own, own, matrix);
  for (int j = 0; j < count; ++j) {
    const int at = contacts[j];
    part_free_.segment<3>(3 * j) = whole.free.segment<3>(3 * at);
    part_lambda_.segment<3>(3 * j) = lambda.segment<3>(3 * at);
    part_bias_[j] = whole.bias[at];
    part_friction_[j] = whole.friction[at];
    part_status_[j] = status[at];
  }
  const ContactProblem part{matrix, part_free_, part_bias_, part_friction_, whole.cone};
  const ContactSolverReport report = solvePart(part, settings, scale, mean_scale, part_lambda_, part_status_);
  for (int j = 0; j < count; ++j) {
    lambda.segment<3>(3 * contacts[j]) = part_lambda_.segment<3>(3 * j);
    status[contacts[j]] = part_status_[j];
  }
  return report;
}

ContactSolverReport ContactSolver::solve(const ContactProblem& problem, const ContactSolverSettings& settings,
                                         VecX& lambda, std::vector<ContactStatus>& status) {
  checkSizes(problem);
  const Eigen::Index rows = problem.free.size();
  const std::size_t m = static_cast<std::size_t>(problem.bias.size());
  ContactSolverReport report;
  if (!isFinite(problem)) {
    lambda.setZero(rows);
    status.assign(m, {});
    report.residual = kInfinity;
    return report;
  }
  report.converged = report.to_tolerance = true;
  if (m == 0) {
    lambda.resize(0);
    status.clear();
    return report;
  }
  if (lambda.size() != rows || !lambda.allFinite()) lambda.setZero(rows);
  const double scale = std::max(problem.free.lpNorm<Eigen::Infinity>(), problem.bias.lpNorm<Eigen::Infinity>());
  const double mean_scale = meanScale(problem);
  findParts(problem);
  const std::size_t parts = part_start_.size() - 1;
  if (parts == 1) return solvePart(problem, settings, scale, mean_scale, lambda, status);
  if (status.size() != m) status.assign(m, {});
  if (parts_.size() < parts) parts_.resize(parts);
  for (std::size_t k = 0; k < parts; ++k) {
    const ContactSolverReport part =
        parts_[k].gatherAndSolve(problem, &order_[part_start_[k]], part_start_[k + 1] - part_start_[k], settings, scale,
                                 mean_scale, lambda, status);
    report.converged = report.converged && part.converged;
    report.to_tolerance = report.to_tolerance && part.to_tolerance;
    report.operations += part.operations;
    report.iterations = std::max(report.iterations, part.iterations);
    report.residual = std::max(report.residual, part.residual);
  }
  return report;
}

/// From where lambda and its states are.
/// @return whether the states can be used: those of a step before, not chosen here
bool ContactSolver::begin(const ContactProblem& problem, double mean_scale, const VecX& lambda,
                          const std::vector<ContactStatus>& status) {
  prepare(problem, mean_scale);
  factor_.forget();
  may_border_ = true;
  lambda_ = lambda;
  status_.assign(static_cast<std::size_t>(rho_.size()), {});
  const bool hinted = !lambda.isZero(0.0) && acceptHint(problem, status);
  updateVelocity(problem, lambda_, w_);
  unmoved_ = lambda_;
  if (hinted) {
    chooseFree(problem);
  } else {
    classify(problem);
    settleStates(problem);
  }
  updateVelocitySince(problem, unmoved_);
  best_.residual = kInfinity;
  return hinted;
}

/// Whether a contact that is open would be passed: its state is wrong, and Newton steps with it lead nowhere.
bool ContactSolver::opensAgainst(const ContactProblem& problem) const {
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    if (status_[i].state == ContactState::open && w_[3 * i] < problem.bias[i]) return true;
  }
  return false;
}

/// The solution from where begin() put it, or the best that work allows, into best_.
/// @param enough  residual of a start that is left as it is
void ContactSolver::find(const ContactProblem& problem, double enough, double tolerance, double acceptable, bool hinted,
                         Work& work) {
  if (keepBest(problem, best_) <= enough) return;
  if (hinted && rho_.size() < kFewContacts) {
    newtonPhase(problem, tolerance, best_, 20, work);
  } else if (hinted) {
    if (!opensAgainst(problem)) newtonPhase(problem, tolerance, best_, 20, work, 0);
    if (best_.residual > tolerance) doubtPhase(problem, tolerance, acceptable, work);
  }
  alternate(problem, tolerance, best_, 2, work);
  if (best_.residual > acceptable) interior(problem, tolerance, acceptable, best_, work);
  if (best_.residual > acceptable) proximal(problem, tolerance, best_, work);
}

/// A problem in one piece; lambda is finite and of the right size. `scale` and `mean_scale` are those of the whole.
ContactSolverReport ContactSolver::solvePart(const ContactProblem& problem, const ContactSolverSettings& settings,
                                             double scale, double mean_scale, VecX& lambda,
                                             std::vector<ContactStatus>& status) {
  const double goal = settings.tolerance * scale;
  const double tolerance = 0.3 * goal;  // room for settling the states
  const double acceptable = std::max(tolerance, 0.3 * settings.acceptable * scale);
  const bool hinted = begin(problem, mean_scale, lambda, status);
  const double m = static_cast<double>(rho_.size());
  Work work;
  work.begin(m, settings.max_iterations,
             std::min(settings.max_work * ((18.0 * m + 2000.0) * m + 2e5) * m, settings.max_operations));
  // a state once settled is good to the goal itself, so that a solution given back is returned as it is
  find(problem, goal, tolerance, acceptable, hinted, work);
  lambda_ = best_.lambda;
  status_ = best_.status;
  ContactSolverReport report;
  report.iterations = work.iterations;
  settleStates(problem);
  updateVelocity(problem, lambda_, w_);
  if (!(residual(problem) <= goal)) makePassive(problem, goal);
  report.residual = residual(problem);
  report.operations = work.operations;
  report.to_tolerance = report.residual <= goal;
  report.converged = report.residual <= std::max(goal, settings.acceptable * scale);
  lambda = lambda_;
  status = status_;
  return report;
}

}  // namespace palpate
