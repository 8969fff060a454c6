#include "shared/contact_rivals.h"

#include <Eigen/Dense>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate::rivals {
namespace {

using Vec2 = Eigen::Vector2d;

double scale(const ContactProblem& p) {
  return std::max(p.free.lpNorm<Eigen::Infinity>(), p.bias.lpNorm<Eigen::Infinity>());
}

/// Keeps the residual, looked at now and then; true when done.
bool done(const ContactProblem& p, double tolerance, int every, Outcome& o) {
  if (o.iterations % every != 0) return false;
  o.residual = contactResidual(p, o.lambda) / scale(p);
  return o.residual <= tolerance;
}

double rho(const ContactProblem& p, Eigen::Index i) { return p.delassus.diagonal().segment<3>(3 * i).sum() / 3.0; }

}  // namespace

Vec2 nearestInSection(const FrictionCone& cone, double radius, const Vec2& p) {
  if (cone.exact) return p.norm() <= radius ? p : Vec2(radius / p.norm() * p);
  const double sector = 2.0 * std::numbers::pi / cone.facets;
  const int k = static_cast<int>(std::floor(std::atan2(p[1], p[0]) / sector));
  const Vec2 n = edgeNormal(k, cone.facets).tail<2>(), t = edgeTangent(k, cone.facets).tail<2>();
  const double reach = radius * std::cos(0.5 * sector), half = radius * std::sin(0.5 * sector);
  if (p.dot(n) <= reach) return p;
  return reach * n + std::clamp(p.dot(t), -half, half) * t;
}

Outcome projectedGaussSeidel(const ContactProblem& p, double tolerance, int limit) {
  Outcome o;
  o.lambda.setZero(p.free.size());
  VecX w = p.free;
  while (!done(p, tolerance, 5, o) && o.iterations < limit) {
    ++o.iterations;
    for (Eigen::Index i = 0; i < p.bias.size(); ++i) {
      const Mat3 block = p.delassus.block<3, 3>(3 * i, 3 * i);
      const Vec3 old = o.lambda.segment<3>(3 * i);
      Vec3 next = old;
      next[0] = std::max(0.0, old[0] - (w[3 * i] - p.bias[i]) / block(0, 0));
      const Vec2 slip =
          w.segment<2>(3 * i + 1) + block.bottomLeftCorner<2, 1>() * (next[0] - old[0]);  // with the new normal impulse
      const double step = 1.0 / block.bottomRightCorner<2, 2>().trace();
      next.tail<2>() = nearestInSection(p.cone, p.friction[i] * next[0], old.tail<2>() - step * slip);
      w.noalias() += p.delassus.middleCols<3>(3 * i) * (next - old);
      o.lambda.segment<3>(3 * i) = next;
    }
  }
  o.residual = contactResidual(p, o.lambda) / scale(p);
  return o;
}

namespace {

/// Nearest point of the cone |t| <= mu n.
Vec3 ontoCone(double mu, const Vec3& x) {
  const double t = x.tail<2>().norm();
  if (t <= mu * x[0]) return x;
  if (mu * t <= -x[0]) return Vec3::Zero();
  const double n = (x[0] + mu * t) / (1.0 + mu * mu);
  if (t == 0.0) return {n, 0.0, 0.0};
  return {n, mu * n / t * x[1], mu * n / t * x[2]};
}

VecX ontoCones(const ContactProblem& p, const VecX& x) {
  VecX y(x.size());
  for (Eigen::Index i = 0; i < p.bias.size(); ++i) y.segment<3>(3 * i) = ontoCone(p.friction[i], x.segment<3>(3 * i));
  return y;
}

}  // namespace

Outcome acceleratedProjectedGradient(const ContactProblem& p, double tolerance, int limit) {
  Outcome o;
  const Eigen::Index m = p.bias.size();
  o.lambda.setZero(p.free.size());
  VecX linear = p.free, y = o.lambda;
  const auto anticipate = [&] {  // the normal velocity that dilation would take, and the bias
    const VecX w = p.delassus * o.lambda + p.free;
    linear = p.free;
    for (Eigen::Index i = 0; i < m; ++i) linear[3 * i] += p.friction[i] * w.segment<2>(3 * i + 1).norm() - p.bias[i];
  };
  anticipate();
  double theta = 1.0, lipschitz = p.delassus.diagonal().maxCoeff();
  constexpr int kEvery = 20;
  while (!done(p, tolerance, kEvery, o) && o.iterations < limit) {
    ++o.iterations;
    const VecX gradient_w = p.delassus * y;
    const VecX gradient = gradient_w + linear;
    const double at_y = y.dot(0.5 * gradient_w + linear);
    VecX next, next_w;
    for (;; lipschitz *= 2.0) {
      next = ontoCones(p, y - gradient / lipschitz);
      next_w = p.delassus * next;
      const VecX d = next - y;
      if (next.dot(0.5 * next_w + linear) <=
          at_y + gradient.dot(d) + 0.5 * lipschitz * d.squaredNorm() + 1e-14 * std::abs(at_y))
        break;
      if (lipschitz > 1e12 * p.delassus.diagonal().maxCoeff()) break;
    }
    const double next_theta = 0.5 * theta * (std::sqrt(theta * theta + 4.0) - theta);
    const double momentum = theta * (1.0 - theta) / (theta * theta + next_theta);
    const bool restart = gradient.dot(next - o.lambda) > 0.0;
    y = next + (restart ? 0.0 : momentum) * (next - o.lambda);
    theta = restart ? 1.0 : next_theta;
    o.lambda = next;
    lipschitz *= 0.9;
    if (o.iterations % kEvery == 0) anticipate();
  }
  o.residual = contactResidual(p, o.lambda) / scale(p);
  return o;
}

Outcome nonsmoothNewton(const ContactProblem& p, double tolerance, int limit) {
  Outcome o;
  const Eigen::Index rows = p.free.size();
  o.lambda.setZero(rows);
  while (!done(p, tolerance, 1, o) && o.iterations < limit) {
    ++o.iterations;
    const VecX w = p.delassus * o.lambda + p.free;
    // F = r lambda - P(r lambda - w); its derivative r I - P' (r I - W)
    VecX f(rows);
    MatX jacobian(rows, rows);
    for (Eigen::Index i = 0; i < p.bias.size(); ++i) {
      const double r = rho(p, i);
      const Vec3 lambda = o.lambda.segment<3>(3 * i);
      Vec3 x = r * lambda - w.segment<3>(3 * i);
      x[0] += p.bias[i];
      Mat3 slope = Mat3::Zero();  // of P
      Vec3 point = Vec3::Zero();
      if (x[0] > 0.0) {
        point[0] = x[0];
        slope(0, 0) = 1.0;
        const double radius = p.friction[i] * x[0];
        const Vec2 t = x.tail<2>(), nearest = nearestInSection(p.cone, radius, t);
        point.tail<2>() = nearest;
        // central differences of a function of three variables: plain, and exact but at its kinks
        const double h = 1e-7 * std::max(radius, t.norm());
        for (int k = 0; k < 3; ++k) {
          Vec3 a = x, b = x;
          a[k] += h;
          b[k] -= h;
          slope.block<2, 1>(1, k) = (nearestInSection(p.cone, p.friction[i] * a[0], a.tail<2>()) -
                                     nearestInSection(p.cone, p.friction[i] * b[0], b.tail<2>())) /
                                    (2.0 * h);
        }
      }
      f.segment<3>(3 * i) = r * lambda - point;
      jacobian.middleRows<3>(3 * i) = slope * p.delassus.middleRows<3>(3 * i);
      jacobian.block<3, 3>(3 * i, 3 * i) += r * (Mat3::Identity() - slope);
      jacobian.diagonal().segment<3>(3 * i).array() += 1e-9 * r;  // redundant contacts
    }
    o.lambda -= jacobian.partialPivLu().solve(f);
    if (!o.lambda.allFinite()) break;
  }
  o.residual = contactResidual(p, o.lambda) / scale(p);
  return o;
}

Outcome constraintAnticipation(const ContactProblem& p, const MatX& system, const MatX& jacobian, const VecX& momentum,
                               double tolerance, int limit) {
  Outcome o;
  const Eigen::Index m = p.bias.size(), n = system.rows();
  const Eigen::SparseMatrix<double> a = system.sparseView(), j = jacobian.sparseView();
  // Blocks of a node, enlarged by the row sums off them, so that the iteration contracts whatever the stiffness.
  MatX inverse = MatX::Zero(3, n), block = MatX::Zero(3, n);
  for (Eigen::Index i = 0; i < n; i += 3) {
    Mat3 d = system.block<3, 3>(i, i);
    const Vec3 all = system.middleRows<3>(i).cwiseAbs().rowwise().sum(), own = d.cwiseAbs().rowwise().sum();
    d.diagonal() += 0.5 * (all - own);
    block.middleCols<3>(i) = d;
    inverse.middleCols<3>(i) = d.inverse();
  }
  MatX scaled(n, 3 * m);  // D^-1 J^T
  for (Eigen::Index i = 0; i < n; i += 3)
    scaled.middleRows<3>(i) = inverse.middleCols<3>(i) * jacobian.middleCols<3>(i).transpose();
  const MatX small = j * scaled;
  o.lambda.setZero(3 * m);
  VecX v = VecX::Zero(n), target(n), w;
  constexpr int kEvery = 10, kInner = 5;
  while (!done(p, tolerance, kEvery, o) && o.iterations < limit) {
    ++o.iterations;
    const VecX defect = momentum - a * v;  // without contact
    for (Eigen::Index i = 0; i < n; i += 3)
      target.segment<3>(i) = v.segment<3>(i) + inverse.middleCols<3>(i) * defect.segment<3>(i);
    w = j * target;
    w += small * o.lambda;
    for (int sweep = 0; sweep < kInner; ++sweep) {
      for (Eigen::Index i = 0; i < m; ++i) {
        const Mat3 own = small.block<3, 3>(3 * i, 3 * i);
        const Vec3 old = o.lambda.segment<3>(3 * i);
        Vec3 next = old;
        next[0] = std::max(0.0, old[0] - (w[3 * i] - p.bias[i]) / own(0, 0));
        const Vec2 slip = w.segment<2>(3 * i + 1) + own.bottomLeftCorner<2, 1>() * (next[0] - old[0]);
        next.tail<2>() = nearestInSection(p.cone, p.friction[i] * next[0],
                                          old.tail<2>() - slip / own.bottomRightCorner<2, 2>().trace());
        w += small.middleCols<3>(3 * i) * (next - old);
        o.lambda.segment<3>(3 * i) = next;
      }
    }
    v = target + scaled * o.lambda;
  }
  o.residual = contactResidual(p, o.lambda) / scale(p);
  return o;
}

}  // namespace palpate::rivals
