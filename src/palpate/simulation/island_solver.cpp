#include "palpate/simulation/island_solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "palpate/common/parallel.h"
#include "palpate/linear/dense_cholesky.h"

namespace palpate {
namespace {

constexpr double kNegligible = 1e-16;  // m/s of residual, where everything is as good as at rest

// Adds the lower triangles of the bodies' own operators at their places.
void addLowerTriangles(const ContactSet& set, ContactIsland& island) {
  MatX& w = island.delassus;
  w.setZero(island.rows(), island.rows());
  for (const int b : island.bodies) {
    const BodyContactRows& own = set.rows[b];
    for (std::size_t j = 0; j < own.contacts.size(); ++j) {
      for (std::size_t i = j; i < own.contacts.size(); ++i) {
        w.block<3, 3>(3 * set.place[own.contacts[i]], 3 * set.place[own.contacts[j]]) +=
            own.delassus.block<3, 3>(static_cast<Eigen::Index>(3 * i), static_cast<Eigen::Index>(3 * j));
      }
    }
  }
}

// Sum over the island's bodies, with both triangles; in tiles that stay in the cache.
void formDelassus(const ContactSet& set, ContactIsland& island) {
  const Eigen::Index rows = island.rows();
  MatX& w = island.delassus;
  const MatX* lower = island.bodies.size() == 1 ? &set.rows[island.bodies.front()].delassus : nullptr;
  if (lower != nullptr) {
    w.resize(rows, rows);
  } else {
    addLowerTriangles(set, island);
  }
  constexpr Eigen::Index kTile = 32;
  parallelFor(static_cast<int>((rows + kTile - 1) / kTile), [&](int tile) {
    const Eigen::Index j = tile * kTile, width = std::min(kTile, rows - j);
    if (lower != nullptr) w.block(j, j, rows - j, width) = lower->block(j, j, rows - j, width);
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

}  // namespace

int IslandSolver::rootOf(int body) {
  while (root_[body] != body) body = root_[body] = root_[root_[body]];
  return body;
}

// Bodies are joined by the contacts that they share.
void IslandSolver::joinBodies(const MovingBodies& bodies, const ContactSet& set) {
  root_.resize(static_cast<std::size_t>(bodies.size()));
  std::iota(root_.begin(), root_.end(), 0);
  for (const Contact& c : set.contacts) {
    const int first = bodies.slot(c.first), second = bodies.slot(c.second);
    if (first < 0 || second < 0) continue;
    const int a = rootOf(first), b = rootOf(second);
    root_[std::max(a, b)] = std::min(a, b);
  }
}

// Takes an island's matrix and report over from the pass before if it is the same and was solved; false if not.
bool IslandSolver::keep(const std::vector<char>& changed, const ContactSet& set, ContactIsland& island) {
  if (set.passes == 1) return false;
  for (const int i : island.contacts) {
    if (changed[i]) return false;
  }
  ContactIsland& before = before_[set.island[island.contacts.front()]];
  if (!before.solver.converged || before.contacts != island.contacts) return false;
  island.delassus.swap(before.delassus);
  island.solver = before.solver;
  island.solver.iterations = 0;
  island.solver.operations = 0;
  return true;
}

void IslandSolver::findIslands(const MovingBodies& bodies, const std::vector<char>& changed, ContactSet& set) {
  joinBodies(bodies, set);
  before_.swap(set.islands);
  of_root_.assign(root_.size(), -1);
  island_.resize(set.contacts.size());
  set.place.resize(set.contacts.size());
  std::size_t count = 0;
  const auto begin = [&] {
    if (set.islands.size() == count) set.islands.emplace_back();
    set.islands[count].contacts.clear();
    set.islands[count].bodies.clear();
    return static_cast<int>(count++);
  };
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    const Contact& c = set.contacts[i];
    const int body = std::max(bodies.slot(c.first), bodies.slot(c.second));
    int alone = -1;  // both stand still: an island of its own
    int& island = body < 0 ? alone : of_root_[rootOf(body)];
    if (island < 0) island = begin();
    island_[i] = island;
    set.place[i] = static_cast<int>(set.islands[island].contacts.size());
    set.islands[island].contacts.push_back(static_cast<int>(i));
  }
  for (int b = 0; b < bodies.size(); ++b) {
    const int island = of_root_[rootOf(b)];
    if (island >= 0) set.islands[island].bodies.push_back(b);
  }
  set.islands.resize(count);
  kept_.assign(count, 0);
  for (std::size_t k = 0; k < count; ++k) kept_[k] = keep(changed, set, set.islands[k]) ? 1 : 0;
  keepGlue(changed, set);
  set.island.swap(island_);
}

// What is glued together stays the same in all passes of a step; so does the factor of W_EE, unless a contact joins two
// such islands.
void IslandSolver::keepGlue(const std::vector<char>& changed, const ContactSet& set) {
  glue_before_.swap(glue_);
  glue_.resize(set.islands.size());
  const auto glued = [&](const ContactIsland& island, std::size_t k) {
    return k < island.contacts.size() && island.contacts[k] < set.glued;
  };
  for (std::size_t k = 0; k < set.islands.size(); ++k) {
    glue_[k].resize(0, 0);
    const ContactIsland& island = set.islands[k];
    if (set.passes == 1 || !glued(island, 0)) continue;
    const auto old = static_cast<std::size_t>(set.island[island.contacts.front()]);
    bool same = true;
    for (std::size_t i = 0; same && (glued(island, i) || glued(before_[old], i)); ++i) {
      same = glued(island, i) && glued(before_[old], i) && island.contacts[i] == before_[old].contacts[i] &&
             changed[island.contacts[i]] == 0;
    }
    if (same) glue_[k].swap(glue_before_[old]);
  }
}

// The island's problem and where its solution starts from. What is glued comes first.
void IslandSolver::gather(const ContactIsland& island, const ContactSet& set, double h, Scratch& own) const {
  const auto all = static_cast<Eigen::Index>(island.contacts.size());
  island.gather(set.free, own.free);
  island.gather(set.impulse, own.impulse);
  own.glued = 0;
  while (own.glued < all && set.contacts[island.contacts[own.glued]].glued()) ++own.glued;
  own.target.resize(3 * own.glued);
  for (Eigen::Index k = 0; k < own.glued; ++k) {
    const Contact& c = set.contacts[island.contacts[k]];
    own.target.segment<3>(3 * k) = -Vec3(c.gap, c.tangent_gap[0], c.tangent_gap[1]) / h;
  }
  const Eigen::Index m = all - own.glued;
  own.bias.resize(m);
  own.friction.resize(m);
  own.status.resize(static_cast<std::size_t>(m));
  for (Eigen::Index k = 0; k < m; ++k) {
    const int i = island.contacts[own.glued + k];
    own.bias[k] = -set.contacts[i].gap / h;
    own.friction[k] = set.contacts[i].friction;
    own.status[k] = set.status[i];
  }
}

// The contacts' problem when what is glued follows, into own.condensed and own.free; own.impulse keeps the contacts'.
// @param glue  a factor of W_EE, or empty: it is found
// @returns false if W_EE is not positive definite
bool IslandSolver::condense(const ContactIsland& island, MatX& glue, Scratch& own) {
  const Eigen::Index e = 3 * own.glued, c = island.rows() - e;
  if (glue.size() == 0) {
    glue = island.delassus.topLeftCorner(e, e);
    if (!glue.allFinite() || !choleskyInPlace(glue)) {
      glue.resize(0, 0);
      return false;
    }
  }
  own.coupled = island.delassus.topRightCorner(e, c);
  const auto lower = glue.triangularView<Eigen::Lower>();
  VecX rest = own.free.head(e) - own.target;
  lower.solveInPlace(rest);
  if (c > 0) lower.solveInPlace(own.coupled);
  own.free = (own.free.tail(c) - own.coupled.transpose() * rest).eval();
  own.impulse = own.impulse.tail(c).eval();
  own.condensed = island.delassus.bottomRightCorner(c, c);
  own.condensed.noalias() -= own.coupled.transpose() * own.coupled;
  return true;
}

// The impulses of all, those of what is glued from the contacts', to rounding.
// @returns what is left of the velocities that glue forbids, the largest [m/s]
double IslandSolver::release(const ContactIsland& island, const MatX& glue, const VecX& free, Scratch& own) {
  constexpr int kRefinements = 2;
  const Eigen::Index e = 3 * own.glued, c = island.rows() - e;
  const auto lower = glue.triangularView<Eigen::Lower>();
  VecX all = VecX::Zero(e + c);
  all.tail(c) = own.impulse;
  double left = 0;
  for (int k = 0; k <= kRefinements; ++k) {
    VecX rest = free.head(e) - own.target;
    rest.noalias() += island.delassus.topRows(e) * all;
    left = rest.lpNorm<Eigen::Infinity>();
    if (k == kRefinements) break;
    lower.solveInPlace(rest);
    glue.transpose().triangularView<Eigen::Upper>().solveInPlace(rest);
    all.head(e) -= rest;
  }
  own.impulse = all;
  return left;
}

// Of the island's contacts that are not glued.
void IslandSolver::solveContacts(const Eigen::Ref<const MatX>& delassus, double scale, const ContactSettings& settings,
                                 ContactIsland& island, Scratch& own) {
  const double largest = std::max(own.free.lpNorm<Eigen::Infinity>(), own.bias.lpNorm<Eigen::Infinity>());
  if (own.status.empty() || largest == 0 || delassus.isZero(0.0)) {
    // nothing moves towards anything, or nothing can move
    own.impulse.setZero();
    own.status.assign(own.status.size(), {});
    island.solver = ContactSolverReport::nothing();
  } else {
    ContactSolverSettings solver = settings.solver;
    if (std::isfinite(scale)) {
      solver.tolerance *= scale / largest;
      solver.acceptable *= scale / largest;
    }
    solver.tolerance = std::max(solver.tolerance, kNegligible / largest);
    // most of them are on dense matrices
    constexpr double kCounts = 0.4;
    solver.max_operations /= kCounts;
    const ContactProblem problem{delassus, own.free, own.bias, own.friction, settings.cone};
    island.solver = own.solver.solve(problem, solver, own.impulse, own.status);
    island.solver.operations *= kCounts;
  }
}

void IslandSolver::solveIsland(std::size_t index, double h, double scale, const ContactSettings& settings,
                               ContactSet& set) {
  ContactIsland& island = set.islands[index];
  Scratch& own = scratch_[index];
  formDelassus(set, island);
  gather(island, set, h, own);
  if (own.glued == 0) {
    solveContacts(island.delassus, scale, settings, island, own);
  } else {
    solveGlued(scale, settings, island, glue_[index], own);
  }
  island.scatter(own.impulse, set.impulse);
  for (std::size_t k = 0; k < island.contacts.size(); ++k) {
    const auto glued = static_cast<std::size_t>(own.glued);
    set.status[island.contacts[k]] = k < glued ? ContactStatus{ContactState::stick, 0} : own.status[k - glued];
  }
}

// With what is glued taken out of the problem first (docs/attachments.md).
void IslandSolver::solveGlued(double scale, const ContactSettings& settings, ContactIsland& island, MatX& glue,
                              Scratch& own) {
  constexpr double kLeft = 1e-6;  // of the largest velocity
  const VecX free = own.free;
  const bool known = glue.size() > 0;
  if (!condense(island, glue, own)) {
    own.impulse.setZero(island.rows());
    own.status.assign(own.status.size(), {});
    island.solver = {false, false, 0, 0.0, std::numeric_limits<double>::infinity()};
    return;
  }
  solveContacts(own.condensed, scale, settings, island, own);
  const double left = release(island, glue, free, own);
  const double e = 3.0 * static_cast<double>(own.glued), c = static_cast<double>(island.rows()) - e;
  island.solver.operations += BodySystem::kDense * ((known ? 0.0 : e * e * e / 3) + e * e * c + e * c * c);
  const double largest = std::max({free.lpNorm<Eigen::Infinity>(), own.target.lpNorm<Eigen::Infinity>(), 1e-12});
  if (left <= kLeft * largest) return;
  island.solver.converged = island.solver.to_tolerance = false;
  island.solver.residual = std::max(island.solver.residual, left);
}

// At the same time, unless one is most of the work: its own loops are shared out then.
void IslandSolver::solve(double h, double scale, const ContactSettings& settings, ContactSet& set) {
  if (scratch_.size() < set.islands.size()) scratch_.resize(set.islands.size());
  const auto work = [&](int k) {
    const double own = kept_[k] ? 0.0 : static_cast<double>(set.islands[k].contacts.size());
    return own * own * own;
  };
  parallelByWeight(static_cast<int>(set.islands.size()), work, [&](int k) {
    if (!kept_[k]) solveIsland(static_cast<std::size_t>(k), h, scale, settings, set);
  });
  set.solver = ContactSolverReport::nothing();
  for (const ContactIsland& island : set.islands) {
    set.solver.converged = set.solver.converged && island.solver.converged;
    set.solver.to_tolerance = set.solver.to_tolerance && island.solver.to_tolerance;
    set.solver.operations += island.solver.operations;
    set.solver.iterations = std::max(set.solver.iterations, island.solver.iterations);
    set.solver.residual = std::max(set.solver.residual, island.solver.residual);
  }
}

}  // namespace palpate
