#include "palpate/friction/contact_interior.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/friction/contact_solver.h"
#include "palpate/linear/dense_lu.h"

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;
using MapX = Eigen::Map<MatX>;

constexpr double kNearBorder = 0.95;   // how much of the way to the border a step may go
constexpr double kLeastCenter = 0.03;  // products are aimed at no less than this part of what they are
constexpr double kBackToCenter = 0.7;  // and at this one after a short step
constexpr double kShortStep = 0.3;
// Damping: least and most, change after a step that was too short, and after one that was not.
constexpr double kLeastDamping = 1e-11;
constexpr double kMostDamping = 1e-2;
constexpr double kDampingUp = 100.0;
constexpr double kDampingDown = 0.1;

/// A rough contact's cone as linear inequalities or a second-order cone: slack s = G lambda lies in the self-dual C,
/// which is the positive orthant (a row for each edge of the polygon) or the round cone |(s_1, s_2)| <= s_0.
class ConeRows {
 public:
  ConeRows(const FrictionCone& cone, const std::vector<Vec2>& normals, double mu)
      : normals_(normals), mu_(mu), reach_(mu * std::cos(std::numbers::pi / std::max(cone.facets, 3))) {
    round_ = cone.exact;
    size_ = cone.exact ? 3 : cone.facets;
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

double InteriorPoint::cost(double contacts) {
  const double rows = 3.0 * contacts;
  return (2.0 / 3.0 * rows + 20.0) * rows * rows;
}

void InteriorPoint::start(const ContactProblem& problem, const VecX& rho, double speed) {
  const Eigen::Index m = rho.size();
  stride_ = problem.cone.exact ? 3 : problem.cone.facets;
  if (!problem.cone.exact) {
    normals_.resize(static_cast<std::size_t>(problem.cone.facets));
    for (std::size_t k = 0; k < normals_.size(); ++k)
      normals_[k] = edgeNormal(static_cast<int>(k), problem.cone.facets).tail<2>();
  }
  for (VecX* v : {&slack_, &dual_, &slack_step_, &dual_step_, &dual_target_}) v->setZero(stride_ * m);
  for (VecX* v : {&surplus_step_, &surplus_target_, &normal_products_}) v->setZero(m);
  impulse_.setZero(3 * m);
  impulse_step_.setZero(3 * m);
  surplus_.setConstant(m, speed);
  count_ = static_cast<double>(m);
  for (Eigen::Index i = 0; i < m; ++i) {
    impulse_[3 * i] = speed / rho[i];
    if (problem.friction[i] == 0.0) continue;
    const ConeRows cone(problem.cone, normals_, problem.friction[i]);
    cone.slack(impulse_.segment<3>(3 * i), &slack_[stride_ * i]);
    for (int k = 0; k < cone.degree(); ++k) dual_[stride_ * i + k] = speed;
    count_ += cone.degree();
  }
  length_ = 1.0;
  damping_ = kLeastDamping;
}

/// Mean product after a part of the step.
double InteriorPoint::products(double length) const {
  double sum = (slack_ + length * slack_step_).dot(dual_ + length * dual_step_);
  for (Eigen::Index i = 0; i < surplus_.size(); ++i) {
    sum += (impulse_[3 * i] + length * impulse_step_[3 * i]) * (surplus_[i] + length * surplus_step_[i]);
  }
  return sum / count_;
}

/// LU of W with what the products add to each contact's block; the velocities' defect besides.
bool InteriorPoint::factorize(const ContactProblem& problem, const VecX& rho) {
  const Eigen::Index rows = problem.free.size(), m = rho.size();
  if (matrix_.size() < static_cast<std::size_t>(rows * rows)) matrix_.resize(static_cast<std::size_t>(rows * rows));
  MapX matrix(matrix_.data(), rows, rows);
  matrix = problem.delassus;
  defect_ = problem.free;
  defect_.noalias() += problem.delassus * impulse_;
  for (Eigen::Index i = 0; i < m; ++i) {
    defect_[3 * i] -= problem.bias[i] + surplus_[i];
    matrix.diagonal().segment<3>(3 * i).array() += damping_ * rho[i];
    matrix(3 * i, 3 * i) += surplus_[i] / impulse_[3 * i];
    if (problem.friction[i] == 0.0) {
      matrix.middleRows<2>(3 * i + 1).setZero();
      matrix.block<2, 2>(3 * i + 1, 3 * i + 1).diagonal().setConstant(rho[i]);
      defect_.segment<2>(3 * i + 1).setZero();
      continue;
    }
    const ConeRows cone(problem.cone, normals_, problem.friction[i]);
    const double *slack = &slack_[stride_ * i], *dual = &dual_[stride_ * i];
    matrix.block<2, 3>(3 * i + 1, 3 * i) += cone.stiffness(slack, dual).bottomRows<2>();
    defect_.segment<2>(3 * i + 1) -= cone.back(dual).tail<2>();
  }
  return luInPlace(matrix, pivots_);
}

/// The step towards products of `aim`, less the products of the steps that are there; returns how far it may be gone.
double InteriorPoint::findStep(const ContactProblem& problem, double aim) {
  const Eigen::Index rows = problem.free.size(), m = surplus_.size();
  impulse_step_ = -defect_;
  for (Eigen::Index i = 0; i < m; ++i) {
    surplus_target_[i] = (aim - normal_products_[i]) / impulse_[3 * i] - surplus_[i];
    impulse_step_[3 * i] += surplus_target_[i];
    if (problem.friction[i] == 0.0) continue;
    const Eigen::Index at = stride_ * i;
    const ConeRows cone(problem.cone, normals_, problem.friction[i]);
    cone.center(&slack_[at], &dual_[at], aim, &slack_step_[at], &dual_step_[at], &dual_target_[at]);
    impulse_step_.segment<2>(3 * i + 1) += cone.back(&dual_target_[at]).tail<2>();
  }
  luSolve(MapX(matrix_.data(), rows, rows), pivots_, impulse_step_);
  double length = 1.0 / kNearBorder;
  dual_step_ = dual_target_;
  for (Eigen::Index i = 0; i < m; ++i) {
    const double normal = impulse_step_[3 * i];
    surplus_step_[i] = surplus_target_[i] - surplus_[i] / impulse_[3 * i] * normal;
    if (normal < 0.0) length = std::min(length, -impulse_[3 * i] / normal);
    if (surplus_step_[i] < 0.0) length = std::min(length, -surplus_[i] / surplus_step_[i]);
    if (problem.friction[i] == 0.0) continue;
    const Eigen::Index at = stride_ * i;
    const ConeRows cone(problem.cone, normals_, problem.friction[i]);
    cone.slack(impulse_step_.segment<3>(3 * i), &slack_step_[at]);
    cone.dualStep(&slack_[at], &dual_[at], &slack_step_[at], &dual_step_[at]);
    length = std::min({length, cone.longest(&slack_[at], &slack_step_[at]), cone.longest(&dual_[at], &dual_step_[at])});
  }
  return kNearBorder * length;
}

bool InteriorPoint::iterate(const ContactProblem& problem, const VecX& rho) {
  if (!factorize(problem, rho)) return false;
  slack_step_.setZero();
  dual_step_.setZero();
  normal_products_.setZero();
  const double average =
      (slack_.dot(dual_) +
       Eigen::Map<const VecX, 0, Eigen::InnerStride<3>>(impulse_.data(), surplus_.size()).dot(surplus_)) /
      count_;
  const double reach = findStep(problem, 0.0);
  const double reached = products(reach);
  const bool stuck = length_ < kShortStep;  // back to the middle, without the corrector's second-order term
  if (stuck) {
    slack_step_.setZero();
    dual_step_.setZero();
  } else {
    for (Eigen::Index i = 0; i < surplus_.size(); ++i) normal_products_[i] = impulse_step_[3 * i] * surplus_step_[i];
  }
  const double part = std::pow(std::clamp(reached / average, 0.0, 1.0), 3);
  length_ = findStep(problem, average * std::max(part, stuck ? kBackToCenter : kLeastCenter));
  if (!(length_ > 1e-12) || !impulse_step_.allFinite()) return false;
  if (length_ < 0.1) {
    damping_ = std::min(damping_ * kDampingUp, kMostDamping);
  } else if (length_ > 0.5) {
    damping_ = std::max(damping_ * kDampingDown, kLeastDamping);
  }
  impulse_ += length_ * impulse_step_;
  surplus_ += length_ * surplus_step_;
  slack_ += length_ * slack_step_;
  dual_ += length_ * dual_step_;
  return true;
}

}  // namespace palpate
