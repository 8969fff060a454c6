#include "palpate/friction/contact_problem.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "palpate/common/parallel.h"

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr Eigen::Index kPartRows = 256;  // of W

double cornerAngle(double index, int facets) { return 2.0 * std::numbers::pi * index / facets; }

Vec2 atAngle(double angle) { return {std::cos(angle), std::sin(angle)}; }

/// Zero times whatever is not finite is not zero; a sum is quicker than asking for each entry.
bool entriesAreFinite(const Eigen::Ref<const MatX>& w) {
  const int columns = static_cast<int>(w.cols()), parts = 1 + (columns - 1) / static_cast<int>(kPartRows);
  std::atomic<bool> good{true};
  parallelRanges(parts, columns, [&](int begin, int end) {
    const double sum = (0.0 * w.middleCols(begin, end - begin)).sum();
    if (!(sum == 0.0)) good.store(false, std::memory_order_relaxed);
  });
  return good.load(std::memory_order_relaxed);
}

constexpr int kAtOnce = 4;  // columns

/// Rows of W from `first` on in the given columns: w += W x and, being rows as well as columns, w += W^T x.
template <int Columns>
void addBothWays(const Eigen::Ref<const MatX>& matrix, Eigen::Index first, Eigen::Index column, const VecX& x,
                 double* w) {
  constexpr Eigen::Index kVector = 8;
  using Vector = Eigen::Array<double, kVector, 1>;
  const Eigen::Index rows = matrix.rows();
  std::array<Vector, Columns> sum;
  std::array<double, Columns> rest;
  std::array<const double*, Columns> a;
  sum.fill(Vector::Zero());
  rest.fill(0.0);
  for (int c = 0; c < Columns; ++c) a[c] = matrix.col(column + c).data();
  Eigen::Index r = first;
  for (; r + kVector <= rows; r += kVector) {
    Eigen::Map<Vector> out(w + r);
    const Vector in = Eigen::Map<const Vector>(x.data() + r);
    Vector share = out;
    for (int c = 0; c < Columns; ++c) {
      const Vector entry = Eigen::Map<const Vector>(a[c] + r);
      share += x[column + c] * entry;
      sum[c] += entry * in;
    }
    out = share;
  }
  for (; r < rows; ++r) {
    for (int c = 0; c < Columns; ++c) {
      w[r] += x[column + c] * a[c][r];
      rest[c] += a[c][r] * x[r];
    }
  }
  for (int c = 0; c < Columns; ++c) w[column + c] += sum[c].sum() + rest[c];
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
  double distance = std::numeric_limits<double>::infinity();
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

}  // namespace

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
  return entriesAreFinite(problem.delassus) && problem.free.allFinite() && problem.bias.allFinite() &&
         problem.friction.allFinite();
}

double impulseScale(const ContactProblem& problem, Eigen::Index i) {
  const auto diagonal = problem.delassus.diagonal();
  return diagonal.segment<3>(3 * i).sum() / 3.0;
}

double meanScale(const ContactProblem& problem) {
  const double mean =
      problem.delassus.trace() / static_cast<double>(std::max<Eigen::Index>(problem.delassus.rows(), 1));
  return mean > 0.0 ? mean : 1.0;
}

Vec3 vertexDirection(int index, int facets) {
  const Vec2 d = atAngle(cornerAngle(wrapped(index, facets), facets));
  return {0.0, d[0], d[1]};
}

Vec3 edgeNormal(int index, int facets) {
  const Vec2 d = atAngle(cornerAngle(wrapped(index, facets) + 0.5, facets));
  return {0.0, d[0], d[1]};
}

Vec3 edgeTangent(int index, int facets) {
  const Vec3 normal = edgeNormal(index, facets);
  return {0.0, -normal[2], normal[1]};
}

double contactResidual(const ContactProblem& problem, const VecX& lambda) {
  checkSizes(problem);
  if (lambda.size() != problem.free.size()) throw std::invalid_argument("contact residual: lambda has the wrong size");
  if (!isFinite(problem) || !lambda.allFinite()) return std::numeric_limits<double>::infinity();
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

// A large W is mostly a matter of reading it: being symmetric, one half is enough. Each part has some columns of the
// lower triangle, and adds to w what they are as columns and as rows.
void contactVelocity(const ContactProblem& problem, const VecX& lambda, AlignedBuffer& shares, VecX& w) {
  const Eigen::Index rows = problem.free.size();
  w = problem.free;
  if (rows <= kPartRows) {
    w.noalias() += problem.delassus * lambda;
    return;
  }
  constexpr Eigen::Index kColumns = 96;
  const int parts = static_cast<int>((rows + kColumns - 1) / kColumns);
  grow(shares, rows * parts);
  Eigen::Map<MatX> by_part(shares.data(), rows, parts);
  parallelFor(parts, [&](int part) {
    const Eigen::Index begin = part * kColumns, own = std::min(kColumns, rows - begin), below = rows - begin - own;
    auto share = by_part.col(part);
    const auto left = lambda.segment(begin, own);
    share.segment(begin, own).noalias() = problem.delassus.block(begin, begin, own, own) * left;
    share.tail(below).setZero();
    Eigen::Index j = 0;
    for (; j + kAtOnce <= own; j += kAtOnce) {
      addBothWays<kAtOnce>(problem.delassus, begin + own, begin + j, lambda, share.data());
    }
    for (; j < own; ++j) addBothWays<1>(problem.delassus, begin + own, begin + j, lambda, share.data());
  });
  for (int part = 0; part < parts; ++part)
    w.tail(rows - part * kColumns) += by_part.col(part).tail(rows - part * kColumns);
}

void gatherBlocks(const ContactProblem& problem, std::span<const int> rows, std::span<const int> columns,
                  Eigen::Ref<MatX> out) {
  for (std::size_t j = 0; j < columns.size(); ++j) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      out.block<3, 3>(static_cast<Eigen::Index>(3 * i), static_cast<Eigen::Index>(3 * j)) =
          problem.delassus.block<3, 3>(3 * rows[i], 3 * columns[j]);
    }
  }
}

}  // namespace palpate
