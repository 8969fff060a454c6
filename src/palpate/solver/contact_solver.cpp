#include "palpate/solver/contact_solver.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;
using Mat2 = Eigen::Matrix2d;
using MapX = Eigen::Map<MatX>;

// Proximal shift relative to rho: where it starts, and its change after a problem solved and after one that was not.
constexpr double first_shift = 1e-2;
constexpr double shift_down = 0.5;
constexpr double shift_up = 5.0;
// Sweeps and Newton steps spent on proximal rounds before the interior-point method. Its iterations: at most; fewer
// than `least` are not worth a start; how near the border a step may end.
constexpr int first_proximal = 30;
constexpr int most_interior = 25;
constexpr int least_interior = 12;
constexpr double near_border = 0.95;
constexpr double infinity = std::numeric_limits<double>::infinity();

double cornerAngle(double index, int facets) { return 2.0 * std::numbers::pi * index / facets; }

Vec2 atAngle(double angle) { return {std::cos(angle), std::sin(angle)}; }

int wrap(int index, int facets) { return ((index % facets) + facets) % facets; }

void checkSizes(const ContactProblem& problem) {
  const Eigen::Index m = problem.bias.size();
  if (problem.free.size() != 3 * m || problem.friction.size() != m || problem.delassus.rows() != 3 * m ||
      problem.delassus.cols() != 3 * m) {
    throw std::invalid_argument("contact problem: delassus, free, bias and friction differ in size");
  }
  if (!problem.cone.exact && problem.cone.facets < 3) {
    throw std::invalid_argument("contact problem: a linearized cone needs at least three facets");
  }
  if ((problem.friction.array() < 0.0).any()) throw std::invalid_argument("contact problem: negative friction");
}

bool isFinite(const ContactProblem& problem) {
  return problem.delassus.allFinite() && problem.free.allFinite() && problem.bias.allFinite() &&
         problem.friction.allFinite();
}

/// Nearest point to p of the segment from a to b.
Vec2 nearestOnSegment(const Vec2& p, const Vec2& a, const Vec2& b) {
  const Vec2 along = b - a;
  const double length2 = along.squaredNorm();
  if (length2 == 0.0) return a;
  return a + std::clamp((p - a).dot(along) / length2, 0.0, 1.0) * along;
}

/// Nearest point to p of the disc or polygon of the given radius, by looking at every edge.
Vec2 nearestInCone(const Vec2& p, double radius, const FrictionCone& cone) {
  if (cone.exact) return p.norm() <= radius ? p : Vec2(radius / p.norm() * p);
  bool inside = true;
  Vec2 nearest = Vec2::Zero();
  double distance = infinity;
  for (int k = 0; k < cone.facets; ++k) {
    const Vec2 a = radius * vertexDirection(k, cone.facets).tail<2>();
    const Vec2 b = radius * vertexDirection(k + 1, cone.facets).tail<2>();
    inside = inside && p.dot(edgeNormal(k, cone.facets).tail<2>()) <= a.dot(edgeNormal(k, cone.facets).tail<2>());
    const Vec2 candidate = nearestOnSegment(p, a, b);
    if ((candidate - p).norm() < distance) {
      distance = (candidate - p).norm();
      nearest = candidate;
    }
  }
  return inside ? p : nearest;
}

/// LU with partial pivoting in place, right-looking in panels; false if a pivot vanishes. Eigen's own keeps its pivots
/// on the heap.
bool luInPlace(Eigen::Ref<MatX> a, std::vector<int>& pivots) {
  constexpr Eigen::Index panel = 32;
  const Eigen::Index n = a.rows();
  if (pivots.size() < static_cast<std::size_t>(n)) pivots.resize(static_cast<std::size_t>(n));
  for (Eigen::Index start = 0; start < n; start += panel) {
    const Eigen::Index width = std::min(panel, n - start);
    const Eigen::Index end = start + width;
    for (Eigen::Index k = start; k < end; ++k) {
      Eigen::Index p = 0;
      const double pivot = a.col(k).tail(n - k).cwiseAbs().maxCoeff(&p);
      p += k;
      pivots[static_cast<std::size_t>(k)] = static_cast<int>(p);
      if (!(pivot > 0.0) || !std::isfinite(pivot)) return false;
      if (p != k) a.row(k).swap(a.row(p));
      a.col(k).tail(n - k - 1) /= a(k, k);
      for (Eigen::Index j = k + 1; j < end; ++j) a.col(j).tail(n - k - 1) -= a(k, j) * a.col(k).tail(n - k - 1);
    }
    const Eigen::Index rest = n - end;
    if (rest == 0) break;
    a.block(start, start, width, width)
        .triangularView<Eigen::UnitLower>()
        .solveInPlace(a.block(start, end, width, rest));
    a.block(end, end, rest, rest).noalias() -= a.block(end, start, rest, width) * a.block(start, end, width, rest);
  }
  return true;
}

void luSolve(const Eigen::Ref<const MatX>& lu, const std::vector<int>& pivots, Eigen::Ref<VecX> x) {
  for (Eigen::Index k = 0; k < x.size(); ++k) std::swap(x[k], x[pivots[static_cast<std::size_t>(k)]]);
  lu.triangularView<Eigen::UnitLower>().solveInPlace(x);
  lu.triangularView<Eigen::Upper>().solveInPlace(x);
}

void grow(std::vector<double, Eigen::aligned_allocator<double>>& buffer, Eigen::Index size) {
  if (buffer.size() < static_cast<std::size_t>(size)) buffer.resize(static_cast<std::size_t>(size));
}

/// rho of contact i: the impulses of a contact times rho compare with its velocities.
double impulseScale(const ContactProblem& problem, Eigen::Index i) {
  const auto diagonal = problem.delassus.diagonal();
  return diagonal.segment<3>(3 * i).sum() / 3.0;
}

double meanScale(const ContactProblem& problem) {
  const double mean =
      problem.delassus.trace() / static_cast<double>(std::max<Eigen::Index>(problem.delassus.rows(), 1));
  return mean > 0.0 ? mean : 1.0;
}

/// One contact with the others held: w = matrix lambda + free (bias already taken off the normal row).
struct Local {
  Mat3 matrix;
  Vec3 free;
  double mu;
  Mat2 schur;     ///< tangential compliance with the normal velocity held at zero
  Vec2 velocity;  ///< tangential velocity without friction impulse, normal velocity held at zero

  void eliminateNormal() {
    const double normal = matrix(0, 0);
    schur = matrix.bottomRightCorner<2, 2>() - matrix.bottomLeftCorner<2, 1>() * matrix.topRightCorner<1, 2>() / normal;
    velocity = free.tail<2>() - matrix.bottomLeftCorner<2, 1>() * (free[0] / normal);
    // keeps the tangential solve defined where a contact cannot move sideways
    schur.diagonal().array() += 1e-14 * matrix.trace();
  }
  double normalImpulse(const Vec2& tangential) const {
    return -(free[0] + matrix(0, 1) * tangential[0] + matrix(0, 2) * tangential[1]) / matrix(0, 0);
  }
  Vec3 impulse(const Vec2& tangential) const { return {normalImpulse(tangential), tangential[0], tangential[1]}; }
};

Vec2 solve2(const Mat2& s, double shift, const Vec2& rhs) {
  const double a = s(0, 0) + shift, b = s(0, 1), c = s(1, 0), d = s(1, 1) + shift;
  const double determinant = a * d - b * c;
  return {(d * rhs[0] - b * rhs[1]) / determinant, (a * rhs[1] - c * rhs[0]) / determinant};
}

/// Sliding on the exact cone: lambda_t = -w_t / alpha, so lambda_t(alpha) = -(S + alpha)^-1 c. Its length falls with
/// alpha, and what is sought is the alpha at which it meets mu lambda_n. Sticking exceeds the cone (alpha = 0) and no
/// friction impulse (alpha = infinity) is within it, so a root is bracketed; Illinois steps in s = alpha / (alpha +
/// trace).
Vec3 slideLocally(const Local& local) {
  const double unit = std::max(local.schur.trace(), 1e-12 * local.matrix.trace());
  const auto excess = [&](double s, Vec2& tangential) {
    if (s >= 1.0) {
      tangential.setZero();
      return -local.mu * local.normalImpulse(tangential);
    }
    tangential = solve2(local.schur, unit * s / (1.0 - s), -local.velocity);
    return tangential.norm() - local.mu * local.normalImpulse(tangential);
  };
  Vec2 tangential;
  double low = 0.0, high = 1.0;
  double at_low = excess(low, tangential), at_high = excess(high, tangential);
  const double accuracy = 1e-15 * std::abs(at_high);
  int side = 0;
  for (int i = 0; i < 60; ++i) {
    double s = (low * at_high - high * at_low) / (at_high - at_low);
    if (i > 30 || !(s > low && s < high)) s = 0.5 * (low + high);
    if (s == low || s == high) break;
    const double value = excess(s, tangential);
    if (std::abs(value) <= accuracy) break;
    if (value > 0.0) {
      low = s;
      at_low = value;
      if (side == 1) at_high *= 0.5;
      side = 1;
    } else {
      high = s;
      at_high = value;
      if (side == -1) at_low *= 0.5;
      side = -1;
    }
  }
  Vec3 lambda = local.impulse(tangential);
  lambda[0] = std::max(lambda[0], 0.0);
  const double length = tangential.norm();
  if (length > 0.0) lambda.tail<2>() *= local.mu * lambda[0] / length;
  return lambda;
}

/// Sliding on the linearized cone: looks through vertices and edges, from the hinted one on, for the one that obeys the
/// law.
struct PolygonSlide {
  const Local& local;
  const std::vector<Vec2>& corner;
  const std::vector<Vec2>& normal;
  const std::vector<Vec2>& tangent;
  int facets;
  double slack;  ///< [m/s] taken for rounding
  double best = infinity;
  Vec3 lambda = Vec3::Zero();
  ContactStatus status = {};

  /// Keeps a candidate if it breaks the law less than those before; true if it obeys.
  bool offer(double violation, const Vec3& candidate, ContactStatus candidate_status) {
    if (violation >= best) return false;
    best = violation;
    lambda = candidate;
    status = candidate_status;
    return best <= slack;
  }

  bool tryVertex(int k) {
    const Vec2& d = corner[k];
    const double row = local.matrix(0, 0) + local.mu * (local.matrix(0, 1) * d[0] + local.matrix(0, 2) * d[1]);
    if (row <= 1e-12 * local.matrix(0, 0)) return false;
    const double n = -local.free[0] / row;
    const Vec3 candidate(n, local.mu * n * d[0], local.mu * n * d[1]);
    const Vec2 w = local.free.tail<2>() + local.matrix.bottomRows<2>() * candidate;
    const int before = k == 0 ? facets - 1 : k - 1, after = k + 1 == facets ? 0 : k + 1;
    return offer(std::max(w.dot(d - corner[before]), w.dot(d - corner[after])), candidate, {ContactState::vertex, k});
  }

  bool tryEdge(int k) {
    // lambda = n (1, mu cos(pi/k) m) + t (0, e), with w_n = 0 and e . w_t = 0
    const double reach = local.mu * std::cos(std::numbers::pi / facets);
    const double half = local.mu * std::sin(std::numbers::pi / facets);
    const Vec3 along(1.0, reach * normal[k][0], reach * normal[k][1]);
    const Vec3 across(0.0, tangent[k][0], tangent[k][1]);
    const Vec3 rows_along = local.matrix * along, rows_across = local.matrix * across;
    const double a = rows_along[0], b = rows_across[0], c = across.dot(rows_along), d = across.dot(rows_across);
    const double determinant = a * d - b * c;
    if (std::abs(determinant) <= 1e-14 * local.matrix(0, 0) * local.matrix.trace()) return false;
    const double f = across.dot(local.free);
    const double n = (-d * local.free[0] + b * f) / determinant;
    const double t = (c * local.free[0] - a * f) / determinant;
    if (n < 0.0) return false;
    const Vec3 candidate = n * along + t * across;
    const Vec2 w = local.free.tail<2>() + local.matrix.bottomRows<2>() * candidate;
    const double beyond = (std::abs(t) - half * n) * d;
    return offer(std::max(w.dot(normal[k]), beyond), candidate, {ContactState::edge, k});
  }

  void search(int hint) {
    for (int j = 0; j < facets; ++j) {
      const int k = (hint + j) % facets;
      if (tryVertex(k) || tryEdge(k)) return;
    }
  }
};

/// One contact's cone as linear inequalities or a second-order cone, for the interior-point method: slack s = G lambda
/// lies in the self-dual C, which is the positive orthant (a row for each edge of the polygon, or the normal impulse
/// alone without friction) or the round cone |(s_1, s_2)| <= s_0.
class ConeRows {
 public:
  ConeRows(const FrictionCone& cone, const std::vector<Vec2>& normals, double mu)
      : normals_(normals), mu_(mu), reach_(mu * std::cos(std::numbers::pi / std::max(cone.facets, 3))) {
    round_ = cone.exact && mu > 0.0;
    size_ = mu == 0.0 ? 1 : cone.exact ? 3 : cone.facets;
  }
  int size() const { return size_; }
  int degree() const { return round_ ? 1 : size_; }

  void slack(const Vec3& lambda, double* s) const {
    for (int k = 0; k < size_; ++k) s[k] = row(k).dot(lambda);
  }
  Vec3 back(const double* z) const {
    Vec3 sum = Vec3::Zero();
    for (int k = 0; k < size_; ++k) sum += z[k] * row(k);
    return sum;
  }
  /// mu times the support function of the cross-section in the direction -w_t: the normal velocity that turns Coulomb's
  /// law into complementarity of the cone and its dual (de Saxce and Feng). And its derivative.
  double dissipation(const Vec2& w, const std::vector<Vec2>& corners, Vec2& slope) const {
    slope.setZero();
    if (mu_ == 0.0) return 0.0;
    if (round_) {
      if (!w.isZero(0.0)) slope = mu_ * w.normalized();
    } else {
      Vec2 most = corners.front();
      for (const Vec2& d : corners)
        if (w.dot(d) < w.dot(most)) most = d;
      slope = -mu_ * most;
    }
    return slope.dot(w);
  }
  static double distance(const double* s) {  // s^T J s without cancellation
    const double tail = std::hypot(s[1], s[2]);
    return (s[0] - tail) * (s[0] + tail);
  }

  /// Scaling of Nesterov and Todd for the round cone, s = N t, z = N^-1 t; for the orthant N is diagonal.
  struct Scaling {
    Mat3 n = Mat3::Identity(), inverse = Mat3::Identity();
    Vec3 point = Vec3::Zero();
  };
  Scaling scaling(const double* s, const double* z) const {
    Scaling result;
    const double ds = distance(s), dz = distance(z);
    const Vec3 unit_s = Vec3(s[0], s[1], s[2]) / std::sqrt(ds), unit_z = Vec3(z[0], z[1], z[2]) / std::sqrt(dz);
    const double gamma = std::sqrt(0.5 * (1.0 + unit_s.dot(unit_z)));
    Vec3 v = (unit_s + mirror(unit_z)) / (2.0 * gamma);
    v[0] += 1.0;
    v /= std::sqrt(2.0 * v[0]);
    const double beta = std::pow(ds / dz, 0.25);
    const Mat3 j = Vec3(1, -1, -1).asDiagonal();
    const Vec3 u = mirror(v);
    result.n = beta * (2.0 * v * v.transpose() - j);
    result.inverse = (2.0 * u * u.transpose() - j) / beta;
    result.point = result.n * Vec3(z[0], z[1], z[2]);
    return result;
  }
  /// What the contact adds to W in the Newton matrix.
  Mat3 stiffness(const double* s, const double* z) const {
    Mat3 sum = Mat3::Zero();
    if (round_) {
      const Mat3 g = scaling(s, z).inverse * Vec3(mu_, 1.0, 1.0).asDiagonal();
      return g.transpose() * g;
    }
    for (int k = 0; k < size_; ++k) sum += (z[k] / s[k]) * row(k) * row(k).transpose();
    return sum;
  }
  /// The dual step at lambda held, c in dz = c - stiffness ds: towards s z = target, less the product of the
  /// predictor's steps ds, dz.
  void center(const double* s, const double* z, double target, const double* ds, const double* dz, double* c) const {
    if (!round_) {
      for (int k = 0; k < size_; ++k) c[k] = (target - ds[k] * dz[k]) / s[k] - z[k];
      return;
    }
    const Scaling at = scaling(s, z);
    const Vec3& p = at.point;
    const Vec3 a = at.inverse * Vec3(ds[0], ds[1], ds[2]), b = at.n * Vec3(dz[0], dz[1], dz[2]);
    const Vec3 d = target * Vec3::UnitX() - product(p, p) - product(a, b);
    const Vec3 x = quotient(p, d);
    Eigen::Map<Vec3> out(c);
    out = at.inverse * x;
  }
  void dualStep(const double* s, const double* z, const double* ds, double* dz) const {
    if (!round_) {
      for (int k = 0; k < size_; ++k) dz[k] -= z[k] / s[k] * ds[k];
      return;
    }
    const Scaling at = scaling(s, z);
    Eigen::Map<Vec3>(dz) -= at.inverse * (at.inverse * Vec3(ds[0], ds[1], ds[2]));
  }
  /// Largest part of the step d from s that stays in C, at most 1e3.
  double longest(const double* s, const double* d) const {
    double most = 1e3;
    if (!round_) {
      for (int k = 0; k < size_; ++k)
        if (d[k] < 0.0) most = std::min(most, -s[k] / d[k]);
      return most;
    }
    const double a = d[0] * d[0] - d[1] * d[1] - d[2] * d[2], b = s[0] * d[0] - s[1] * d[1] - s[2] * d[2];
    const double c = distance(s);
    const double root = b * b - a * c;
    if (d[0] < 0.0) most = std::min(most, -s[0] / d[0]);
    if (root < 0.0 || (a >= 0.0 && b >= 0.0)) return most;
    const double t = b < 0.0 ? c / (-b + std::sqrt(root)) : (-b - std::sqrt(root)) / a;
    return t > 0.0 ? std::min(most, t) : most;
  }

 private:
  Vec3 row(int k) const {
    if (mu_ == 0.0) return Vec3::UnitX();
    if (round_) return k == 0 ? Vec3(mu_, 0, 0) : Vec3(0, k == 1, k == 2);
    return {reach_, -normals_[k][0], -normals_[k][1]};
  }
  static Vec3 mirror(const Vec3& v) { return {v[0], -v[1], -v[2]}; }
  static Vec3 product(const Vec3& a, const Vec3& b) {
    return {a.dot(b), a[0] * b[1] + b[0] * a[1], a[0] * b[2] + b[0] * a[2]};
  }
  /// x with product(p, x) = d
  static Vec3 quotient(const Vec3& p, const Vec3& d) {
    const double dp = p[1] * d[1] + p[2] * d[2];
    const double x0 = (p[0] * d[0] - dp) / distance(p.data());
    return {x0, (d[1] - x0 * p[1]) / p[0], (d[2] - x0 * p[2]) / p[0]};
  }

  const std::vector<Vec2>& normals_;
  double mu_, reach_;
  bool round_ = false;
  int size_ = 0;
};

}  // namespace

Vec3 vertexDirection(int index, int facets) {
  const Vec2 d = atAngle(cornerAngle(wrap(index, facets), facets));
  return {0.0, d[0], d[1]};
}

Vec3 edgeNormal(int index, int facets) {
  const Vec2 d = atAngle(cornerAngle(wrap(index, facets) + 0.5, facets));
  return {0.0, d[0], d[1]};
}

Vec3 edgeTangent(int index, int facets) {
  const Vec3 normal = edgeNormal(index, facets);
  return {0.0, -normal[2], normal[1]};
}

double contactResidual(const ContactProblem& problem, const VecX& lambda) {
  checkSizes(problem);
  if (lambda.size() != problem.free.size()) throw std::invalid_argument("contact residual: lambda has the wrong size");
  if (!isFinite(problem) || !lambda.allFinite()) return infinity;
  const VecX w = problem.delassus * lambda + problem.free;
  double worst = 0.0;
  for (Eigen::Index i = 0; i < problem.bias.size(); ++i) {
    const double own = impulseScale(problem, i);
    const double rho = own > 0.0 ? own : meanScale(problem);
    const Vec3 impulse = rho * lambda.segment<3>(3 * i);
    const double normal = impulse[0] - std::max(0.0, impulse[0] - (w[3 * i] - problem.bias[i]));
    const double radius = problem.friction[i] * std::max(0.0, impulse[0]);
    const Vec2 moved = impulse.tail<2>() - w.segment<2>(3 * i + 1);
    const double tangential = (impulse.tail<2>() - nearestInCone(moved, radius, problem.cone)).norm();
    worst = std::max({worst, std::abs(normal), tangential});
  }
  return worst;
}

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

void ContactSolver::updateVelocity(const ContactProblem& problem, const VecX& lambda, VecX& w) const {
  w = problem.free;
  w.noalias() += problem.delassus * lambda;
}

/// Nearest point of the cross-section of the given radius, and the state that it means.
ContactStatus ContactSolver::nearest(const FrictionCone& cone, double radius, const Vec2& p, Vec2& point) const {
  if (cone.exact) {
    const double length = p.norm();
    point = length < radius ? p : Vec2(length > 0.0 ? Vec2(radius / length * p) : Vec2::Zero());
    return {length < radius ? ContactState::stick : ContactState::slide, 0};
  }
  const double sector = 2.0 * std::numbers::pi / cone.facets;
  const int k = wrap(static_cast<int>(std::floor(std::atan2(p[1], p[0]) / sector)), cone.facets);
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
  const int vertex = wrap(along > 0.0 ? k + 1 : k, cone.facets);
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
    if (!std::isfinite(impulse.sum())) return infinity;
  }
  return worst;
}

/// States from the augmented impulse rho lambda - w, as in the nonsmooth Newton method of Alart and Curnier.
void ContactSolver::classify(const ContactProblem& problem) {
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    Vec3 augmented = rho_[i] * lambda_.segment<3>(3 * i) - w_.segment<3>(3 * i);
    augmented[0] += problem.bias[i];
    if (augmented[0] <= 0.0) {
      status_[i] = {};
    } else if (problem.friction[i] == 0.0) {
      status_[i] = {ContactState::slide, 0};
    } else {
      Vec2 point;
      status_[i] = nearest(problem.cone, problem.friction[i] * augmented[0], augmented.tail<2>(), point);
      if (point.squaredNorm() > 0.0) heading_[i] = point.normalized();
    }
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
    Local local;
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
        after = slideLocally(local);
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

/// Free directions and test rows of the closed contacts, sticking ones first; lambda is moved onto what the states
/// allow.
void ContactSolver::chooseFree(const ContactProblem& problem) {
  free_.clear();
  stick_unknowns_ = 0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    if (status_[i].state != ContactState::stick) continue;
    Free& f = free_.emplace_back();
    f.contact = static_cast<int>(i);
    f.dims = 3;
    f.offset = stick_unknowns_;
    f.b.setIdentity();
    f.c.setIdentity();
    stick_unknowns_ += 3;
  }
  slip_unknowns_ = 0;
  for (Eigen::Index i = 0; i < rho_.size(); ++i) {
    auto impulse = lambda_.segment<3>(3 * i);
    const ContactStatus status = status_[i];
    if (status.state == ContactState::open) impulse.setZero();
    if (status.state == ContactState::open || status.state == ContactState::stick) continue;
    const double mu = problem.friction[i];
    impulse[0] = std::max(impulse[0], 0.0);
    Free& f = free_.emplace_back();
    f.contact = static_cast<int>(i);
    f.offset = slip_unknowns_;
    f.c(0, 0) = f.b(0, 0) = 1.0;
    f.dims = 1;
    Vec2 along = Vec2::Zero(), across = Vec2::Zero();
    if (status.state == ContactState::vertex) {
      along = corner_[status.index];
    } else if (status.state == ContactState::edge) {
      along = std::cos(std::numbers::pi / problem.cone.facets) * normal_[status.index];
      across = tangent_[status.index];
      f.dims = 2;
    } else if (mu > 0.0) {
      along = heading_[i];
      across = Vec2(-along[1], along[0]);
      f.dims = 2;
    }
    const double offset = status.state == ContactState::edge ? across.dot(impulse.tail<2>()) : 0.0;
    f.b.block<2, 1>(1, 0) = mu * along;
    f.b.block<2, 1>(1, 1) = f.c.block<2, 1>(1, 1) = across;
    impulse.tail<2>() = mu * impulse[0] * along + offset * across;
    slip_unknowns_ += f.dims;
  }
}

/// On the exact cone the friction direction turns with the velocity: d(e_perp . w_t) has -(e . w_t) dtheta besides.
void ContactSolver::setCurvature(const ContactProblem& problem) {
  if (!problem.cone.exact) return;
  for (Free& f : free_) {
    if (f.dims != 2) continue;
    const double radius = problem.friction[f.contact] * lambda_[3 * f.contact];
    const double dissipated = std::max(0.0, -heading_[f.contact].dot(w_.segment<2>(3 * f.contact + 1)));
    const double largest = 1e8 * rho_[f.contact];
    f.curvature = dissipated < largest * radius ? dissipated / radius : (dissipated > 0.0 ? largest : 0.0);
  }
}

/// Factor of  C^T W B + curvature + regularization rho:  Cholesky of the sticking rows, LU of the rest's Schur
/// complement.
bool ContactSolver::factorize(const ContactProblem& problem, double regularization) {
  const Eigen::Index ns = stick_unknowns_, nv = slip_unknowns_, rows = problem.free.size();
  grow(stick_matrix_, ns * ns);
  grow(right_, ns * nv);
  grow(left_, ns * nv);
  grow(slip_matrix_, nv * nv);
  grow(column_, 2 * rows);
  MapX stick(stick_matrix_.data(), ns, ns), right(right_.data(), ns, nv), left(left_.data(), ns, nv);
  MapX slip(slip_matrix_.data(), nv, nv);
  Eigen::Map<VecX> moved(column_.data(), rows), tested(column_.data() + rows, rows);
  for (const Free& j : free_) {
    if (j.offset + 3 <= ns && j.dims == 3) {
      for (const Free& i : free_) {
        if (i.dims != 3) break;
        stick.block<3, 3>(i.offset, j.offset) = problem.delassus.block<3, 3>(3 * i.contact, 3 * j.contact);
      }
      stick.diagonal().segment<3>(j.offset).array() += regularization * rho_[j.contact];
      continue;
    }
    for (int d = 0; d < j.dims; ++d) {
      const Eigen::Index column = j.offset + d;
      moved.noalias() = problem.delassus.middleCols<3>(3 * j.contact) * j.b.col(d);
      tested.noalias() = problem.delassus.middleCols<3>(3 * j.contact) * j.c.col(d);
      for (const Free& i : free_) {
        if (i.dims == 3) {
          right.block<3, 1>(i.offset, column) = moved.segment<3>(3 * i.contact);
          left.block<3, 1>(i.offset, column) = tested.segment<3>(3 * i.contact);
        } else {
          for (int e = 0; e < i.dims; ++e) slip(i.offset + e, column) = i.c.col(e).dot(moved.segment<3>(3 * i.contact));
        }
      }
      slip(column, column) += regularization * rho_[j.contact] + (d == 1 ? j.curvature : 0.0);
    }
  }
  if (ns > 0) {
    Eigen::Ref<MatX> in_place(stick);
    const Eigen::LLT<Eigen::Ref<MatX>> cholesky(in_place);
    if (cholesky.info() != Eigen::Success) return false;
  }
  if (nv == 0) return true;
  if (ns > 0) {
    const auto lower = stick.triangularView<Eigen::Lower>();
    lower.solveInPlace(right);
    lower.solveInPlace(left);
    slip.noalias() -= left.transpose() * right;
  }
  return luInPlace(slip, pivots_);
}

/// Minus what the states leave of the rows that should vanish, into rhs_; returns the largest.
double ContactSolver::freeResidual(const ContactProblem& problem) {
  const Eigen::Index unknowns = stick_unknowns_ + slip_unknowns_;
  rhs_.resize(problem.free.size());  // as many as there can be, so that it keeps its size
  for (const Free& f : free_) {
    const int offset = f.dims == 3 ? f.offset : stick_unknowns_ + f.offset;
    Vec3 w = w_.segment<3>(3 * f.contact);
    w[0] -= problem.bias[f.contact];
    if (problem.cone.exact && f.dims == 2) {
      const Vec2& along = heading_[f.contact];
      rhs_[offset] = -w[0];
      rhs_[offset + 1] = along[1] * w[1] - along[0] * w[2];
    } else {
      for (int d = 0; d < f.dims; ++d) rhs_[offset + d] = -f.c.col(d).dot(w);
    }
  }
  return unknowns > 0 ? rhs_.head(unknowns).lpNorm<Eigen::Infinity>() : 0.0;
}

/// Solves with the factor for rhs_ and moves lambda along the free directions.
void ContactSolver::stepFree(const ContactProblem& problem) {
  const Eigen::Index ns = stick_unknowns_, nv = slip_unknowns_;
  const Eigen::Map<const MatX> stick(stick_matrix_.data(), ns, ns), right(right_.data(), ns, nv),
      left(left_.data(), ns, nv), slip(slip_matrix_.data(), nv, nv);
  auto sticking = rhs_.head(ns);
  auto slipping = rhs_.segment(ns, nv);
  if (ns > 0) stick.triangularView<Eigen::Lower>().solveInPlace(sticking);
  if (nv > 0) {
    if (ns > 0) slipping.noalias() -= left.transpose() * sticking;
    luSolve(slip, pivots_, slipping);
    if (ns > 0) sticking.noalias() -= right * slipping;
  }
  if (ns > 0) stick.transpose().triangularView<Eigen::Upper>().solveInPlace(sticking);
  for (const Free& f : free_) {
    auto impulse = lambda_.segment<3>(3 * f.contact);
    const auto change = rhs_.segment(f.dims == 3 ? f.offset : stick_unknowns_ + f.offset, f.dims);
    if (f.dims == 3) {
      impulse += change;
    } else if (!problem.cone.exact || f.dims == 1) {
      for (int d = 0; d < f.dims; ++d) impulse += change[d] * f.b.col(d);
    } else {
      // along the cone's tangent plane, then back onto the cone
      Vec2& along = heading_[f.contact];
      impulse[0] += change[0];
      const double radius = problem.friction[f.contact] * impulse[0];
      if (radius > 0.0) along = (radius * along + change[1] * Vec2(-along[1], along[0])).normalized();
      impulse.tail<2>() = radius * along;
    }
  }
}

/// Solves the linear system that the states leave. Proximal: regularised so that redundant contacts do no harm, then
/// repeated with the same factor, which takes the regularization out again and stays near the impulses it came from.
bool ContactSolver::newton(const ContactProblem& problem, double tolerance, Work& work) {
  chooseFree(problem);
  updateVelocity(problem, lambda_, w_);
  setCurvature(problem);
  double regularization = 1e-9;
  const double stick = stick_unknowns_, slip = slip_unknowns_;
  const double cost = stick * stick * stick / 3.0 + 2.0 * stick * slip * slip + 2.0 * stick * stick * slip +
                      2.0 / 3.0 * slip * slip * slip + 2.0 * slip * work.rows;
  work.operations += cost;
  while (!factorize(problem, regularization)) {
    work.operations += cost;
    regularization *= 100.0;
    if (regularization > 1.0) return false;
  }
  double before = infinity;
  for (int k = 0; k < 6; ++k) {
    const double left = freeResidual(problem);
    if (left <= 0.1 * tolerance || left > 0.5 * before || !std::isfinite(left)) break;
    before = left;
    stepFree(problem);
    updateVelocity(problem, lambda_, w_);
  }
  return lambda_.allFinite();
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
void ContactSolver::newtonPhase(const ContactProblem& problem, double tolerance, Best& best, int steps, Work& work) {
  double phase_best = infinity;
  int stalled = 0;
  for (int k = 0; k < steps && work.left(); ++k) {
    work.spend(6.0 * work.product);
    if (!newton(problem, tolerance, work)) return;
    const double now = keepBest(problem, best);
    if (now <= tolerance) return;
    stalled = now < 0.9 * phase_best ? 0 : stalled + 1;
    phase_best = std::min(phase_best, now);
    if (stalled == 4) return;
    classify(problem);
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
    swept_.residual = infinity;
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
  double applied = 0.0;
  double shift = first_shift;
  center_ = best;
  while (best.residual > tolerance && work.left()) {
    shifted_free_ = problem.free;
    for (Eigen::Index i = 0; i < rho_.size(); ++i) {
      shifted.diagonal().segment<3>(3 * i).array() += (shift - applied) * rho_[i];
      shifted_free_.segment<3>(3 * i) -= shift * rho_[i] * center_.lambda.segment<3>(3 * i);
    }
    applied = shift;
    const ContactProblem nearby{shifted, shifted_free_, problem.bias, problem.friction, problem.cone};
    goTo(nearby, center_);
    nearby_ = center_;
    nearby_.residual = residual(nearby);
    const double goal = std::max(0.01 * best.residual, tolerance);
    newtonPhase(nearby, goal, nearby_, 20, work);
    const bool solved = alternate(nearby, goal, nearby_, 5, work);
    goTo(problem, nearby_);
    center_.residual = infinity;
    keepBest(problem, center_);
    keepBest(problem, best);
    if (best.residual <= tolerance) return;
    newtonPhase(problem, tolerance, best, 4, work);
    shift = solved ? std::max(shift * shift_down, 1e-6) : std::min(shift * shift_up, 10.0);
  }
}

/// Interior-point iterations (Mehrotra's predictor and corrector) on the cones and their duals. Their central path
/// leads to the middle of the set of solutions, where redundant contacts share the load; Newton steps on the states
/// finish. The dissipation that Coulomb's law adds to the normal rows is differentiated too, hence LU.
void ContactSolver::interior(const ContactProblem& problem, double tolerance, Best& best, Work& work) {
  const Eigen::Index rows = problem.free.size();
  const double cost = 2.0 / 3.0 * std::pow(static_cast<double>(rows), 3) + 2.0 * work.product;
  if (work.remaining() < least_interior * cost) return;
  const double speed = std::max(problem.free.lpNorm<Eigen::Infinity>(), problem.bias.lpNorm<Eigen::Infinity>());
  const double count = static_cast<double>(startInterior(problem, speed));
  double attempted = infinity, length = 1.0;
  for (int k = 0; k < most_interior && work.left(); ++k) {
    work.spend(cost);
    lambda_ = inner_lambda_;
    updateVelocity(problem, lambda_, w_);
    classify(problem);
    settleStates(problem);
    updateVelocity(problem, lambda_, w_);
    const double now = keepBest(problem, best);
    if (now <= tolerance) return;
    if (now < 1e-4 * speed && now < 0.1 * attempted) {
      attempted = now;
      newtonPhase(problem, tolerance, best, 1, work);
      if (best.residual <= tolerance) return;
    }
    updateVelocity(problem, inner_lambda_, w_);
    if (!factorizeInterior(problem)) return;
    const double average = slack_.dot(dual_) / count;
    slack_step_.setZero();
    dual_step_.setZero();
    const double reach = interiorStep(problem, 0.0);
    const double reached = (slack_ + reach * slack_step_).dot(dual_ + reach * dual_step_) / count;
    const bool stuck = length < 0.3;  // near the border: back to the middle, without the corrector's second-order term
    if (stuck) {
      slack_step_.setZero();
      dual_step_.setZero();
    }
    length = interiorStep(problem,
                          average * std::max(std::pow(std::clamp(reached / average, 0.0, 1.0), 3), stuck ? 0.7 : 0.1));
    if (!(length > 1e-10) || !inner_step_.allFinite()) return;
    inner_lambda_ += length * inner_step_;
    slack_ += length * slack_step_;
    dual_ += length * dual_step_;
  }
}

/// A point inside all cones; returns the number of products that should vanish.
Eigen::Index ContactSolver::startInterior(const ContactProblem& problem, double speed) {
  const Eigen::Index m = rho_.size();
  cone_stride_ = problem.cone.exact ? 3 : problem.cone.facets;
  for (VecX* v : {&slack_, &dual_, &slack_step_, &dual_step_, &target_}) v->setZero(cone_stride_ * m);
  inner_lambda_.setZero(3 * m);
  inner_step_.resize(3 * m);
  Eigen::Index count = 0;
  for (Eigen::Index i = 0; i < m; ++i) {
    const ConeRows cone(problem.cone, normal_, problem.friction[i]);
    inner_lambda_[3 * i] = speed / rho_[i];
    cone.slack(inner_lambda_.segment<3>(3 * i), &slack_[cone_stride_ * i]);
    for (int k = 0; k < cone.degree(); ++k) dual_[cone_stride_ * i + k] = speed;
    count += cone.degree();
  }
  return count;
}

/// LU of W, the cones' stiffness and the derivative of the dissipation; the residual of the velocities besides.
bool ContactSolver::factorizeInterior(const ContactProblem& problem) {
  const Eigen::Index rows = problem.free.size(), m = rho_.size();
  grow(shifted_matrix_, rows * rows);
  MapX matrix(shifted_matrix_.data(), rows, rows);
  matrix = problem.delassus;
  dual_residual_ = w_;
  for (Eigen::Index i = 0; i < m; ++i) {
    const ConeRows cone(problem.cone, normal_, problem.friction[i]);
    const double *slack = &slack_[cone_stride_ * i], *dual = &dual_[cone_stride_ * i];
    Vec2 slope;
    dual_residual_[3 * i] += cone.dissipation(w_.segment<2>(3 * i + 1), corner_, slope) - problem.bias[i];
    dual_residual_.segment<3>(3 * i) -= cone.back(dual);
    const Mat3 stiffness = cone.stiffness(slack, dual);
    if (!slope.isZero(0.0)) {
      const auto w_rows = problem.delassus.middleRows<2>(3 * i + 1);
      matrix.row(3 * i) += slope[0] * w_rows.row(0) + slope[1] * w_rows.row(1);
    }
    matrix.block<3, 3>(3 * i, 3 * i) += stiffness;
    matrix.diagonal().segment<3>(3 * i).array() += 1e-11 * rho_[i] + 1e-15 * stiffness.trace();
  }
  return luInPlace(matrix, pivots_);
}

/// The step towards products of `aim`, less the product of the steps that are there; returns how far it may be gone.
double ContactSolver::interiorStep(const ContactProblem& problem, double aim) {
  const Eigen::Index rows = problem.free.size(), m = rho_.size();
  inner_step_ = -dual_residual_;
  for (Eigen::Index i = 0; i < m; ++i) {
    const Eigen::Index at = cone_stride_ * i;
    const ConeRows cone(problem.cone, normal_, problem.friction[i]);
    cone.center(&slack_[at], &dual_[at], aim, &slack_step_[at], &dual_step_[at], &target_[at]);
    inner_step_.segment<3>(3 * i) += cone.back(&target_[at]);
  }
  luSolve(MapX(shifted_matrix_.data(), rows, rows), pivots_, inner_step_);
  double length = 1.0 / near_border;
  dual_step_ = target_;
  for (Eigen::Index i = 0; i < m; ++i) {
    const Eigen::Index at = cone_stride_ * i;
    const ConeRows cone(problem.cone, normal_, problem.friction[i]);
    cone.slack(inner_step_.segment<3>(3 * i), &slack_step_[at]);
    cone.dualStep(&slack_[at], &dual_[at], &slack_step_[at], &dual_step_[at]);
    length = std::min({length, cone.longest(&slack_[at], &slack_step_[at]), cone.longest(&dual_[at], &dual_step_[at])});
  }
  return near_border * length;
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
  constexpr int gentle = 200, rounds = 210;
  constexpr double beyond = 1.2;  // over-relaxation, so that few rounds do
  for (int round = 0; round <= rounds; ++round) {
    bool changed = false;
    for (Eigen::Index i = 0; i < rho_.size(); ++i) {
      const Vec2 friction = lambda_.segment<2>(3 * i + 1);
      const double power = friction.dot(w_.segment<2>(3 * i + 1));
      if (friction.isZero(0.0) || (power <= slack * friction.norm() && round < rounds)) continue;
      const double own = friction.dot(problem.delassus.block<2, 2>(3 * i + 1, 3 * i + 1) * friction);
      // with the share s of the friction its power is s (others + s own)
      const double share = own > 0.0 && round < gentle ? std::clamp(1.0 - beyond * power / own, 0.0, 1.0) : 0.0;
      lambda_.segment<2>(3 * i + 1) = share * friction;
      w_.noalias() += problem.delassus.middleCols<2>(3 * i + 1) * ((share - 1.0) * friction);
      status_[i] = {ContactState::stick, 0};
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
  for (int j = 0; j < count; ++j) {
    const int at = contacts[j];
    for (int i = 0; i < count; ++i) {
      matrix.block<3, 3>(3 * i, 3 * j) = whole.delassus.block<3, 3>(3 * contacts[i], 3 * at);
    }
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
    report.residual = infinity;
    return report;
  }
  report.converged = true;
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
    report.iterations = std::max(report.iterations, part.iterations);
    report.residual = std::max(report.residual, part.residual);
  }
  return report;
}

/// A problem in one piece; lambda is finite and of the right size. `scale` and `mean_scale` are those of the whole.
ContactSolverReport ContactSolver::solvePart(const ContactProblem& problem, const ContactSolverSettings& settings,
                                             double scale, double mean_scale, VecX& lambda,
                                             std::vector<ContactStatus>& status) {
  const double goal = settings.tolerance * scale;
  const double tolerance = 0.3 * goal;  // room for settling the states
  const double acceptable = std::max(tolerance, 0.3 * settings.acceptable * scale);
  prepare(problem, mean_scale);
  const bool warm = !lambda.isZero(0.0);
  lambda_ = lambda;
  status_.assign(static_cast<std::size_t>(rho_.size()), {});
  const bool hinted = warm && acceptHint(problem, status);
  updateVelocity(problem, lambda_, w_);
  if (hinted) {
    chooseFree(problem);
    updateVelocity(problem, lambda_, w_);
  } else {
    classify(problem);
    settleStates(problem);
    updateVelocity(problem, lambda_, w_);
  }
  const double m = static_cast<double>(rho_.size());
  Work work;
  work.max_iterations = settings.max_iterations;
  work.max_operations = std::min(settings.max_work * ((18.0 * m + 2000.0) * m + 2e5) * m, settings.max_operations);
  work.rows = 3.0 * m;
  work.product = 90.0 * m * m;
  best_.residual = infinity;
  // a state once settled is good to the goal itself, so that a solution given back is returned as it is
  if (keepBest(problem, best_) > goal) {
    if (hinted) newtonPhase(problem, tolerance, best_, 20, work);
    if (!alternate(problem, tolerance, best_, 2, work) && best_.residual > acceptable) {
      // a few proximal rounds are cheaper than the interior-point method, many are not
      work.max_iterations = std::min(settings.max_iterations, work.iterations + first_proximal);
      proximal(problem, tolerance, best_, work);
      work.max_iterations = settings.max_iterations;
    }
    if (best_.residual > acceptable) interior(problem, tolerance, best_, work);
    if (best_.residual > acceptable) proximal(problem, tolerance, best_, work);
    lambda_ = best_.lambda;
    status_ = best_.status;
  }
  ContactSolverReport report;
  report.iterations = work.iterations;
  settleStates(problem);
  updateVelocity(problem, lambda_, w_);
  if (!(residual(problem) <= goal)) makePassive(problem, goal);
  report.residual = residual(problem);
  report.converged = report.residual <= std::max(goal, settings.acceptable * scale);
  lambda = lambda_;
  status = status_;
  return report;
}

}  // namespace palpate
