#include "palpate/friction/state_factor.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "palpate/common/parallel.h"
#include "palpate/linear/dense_cholesky.h"
#include "palpate/linear/dense_lu.h"
#include "palpate/linear/triangular_solve.h"

namespace palpate {
namespace {

using MapX = Eigen::Map<MatX>;

constexpr double kFirstRegularization = 1e-9;
constexpr Eigen::Index kSmall = 48;      // unknowns up to which one LU of all costs less than blocks
constexpr int kLeastUnknowns = 96;       // a factor of fewer is as cheap as a border
constexpr double kWorthBordering = 0.5;  // of a factorization's operations
constexpr double kSameDirection = 1e-10;
constexpr Eigen::Index kPartColumns = 32;
const FreeDirections kOpen;

struct Unknowns {
  Eigen::Index stick = 0, slip = 0;
};

Unknowns count(const std::vector<FreeDirections>& free) {
  Unknowns n;
  for (const FreeDirections& f : free) (f.dims == 3 ? n.stick : n.slip) += f.dims;
  return n;
}

/// Orthonormal columns.
struct Span {
  int dims = 0;
  Mat3 basis = Mat3::Zero();

  Vec3 beyond(Vec3 v) const {
    for (int i = 0; i < dims; ++i) v -= basis.col(i).dot(v) * basis.col(i);
    return v;
  }
};

Span spanOf(const Mat3& columns, int dims) {
  Span span{dims, Mat3::Zero()};
  for (int i = 0; i < dims; ++i) span.basis.col(i) = columns.col(i).normalized();
  return span;
}

Span intersection(const Span& a, const Span& b) {
  if (a.dims > b.dims) return intersection(b, a);
  if (a.dims == 0 || b.dims == 3) return a;
  if (a.dims == 1) return b.beyond(a.basis.col(0)).norm() < kSameDirection ? a : Span{};
  const Vec3 line = a.basis.col(0).cross(a.basis.col(1)).cross(b.basis.col(0).cross(b.basis.col(1)));
  if (line.norm() < kSameDirection) return a;
  Span span{1, Mat3::Zero()};
  span.basis.col(0) = line.normalized();
  return span;
}

/// Appends orthonormal directions that make up for what `part` leaves of `whole`.
template <typename Add>
void forRest(const Span& whole, Span part, const Add& add) {
  while (part.dims < whole.dims) {
    Vec3 best = Vec3::Zero();
    for (int i = 0; i < whole.dims; ++i) {
      const Vec3 v = part.beyond(whole.basis.col(i));
      if (v.squaredNorm() > best.squaredNorm()) best = v;
    }
    part.basis.col(part.dims++) = best.normalized();
    add(part.basis.col(part.dims - 1));
  }
}

void whereContactsAre(const std::vector<FreeDirections>& free, std::vector<int>& at) {
  std::fill(at.begin(), at.end(), -1);
  for (std::size_t i = 0; i < free.size(); ++i) at[static_cast<std::size_t>(free[i].contact)] = static_cast<int>(i);
}

double factorCost(const Unknowns& n, double rows) {
  const double stick = static_cast<double>(n.stick), slip = static_cast<double>(n.slip);
  return stick * stick * stick / 3.0 + 2.0 * stick * slip * slip + 2.0 * stick * stick * slip +
         2.0 / 3.0 * slip * slip * slip + 2.0 * slip * rows;
}

double borderCost(double unknowns, double border) {
  return (3.0 * unknowns * unknowns + 2.0 * unknowns * border + border * border) * border;
}

}  // namespace

bool StateFactor::prepare(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                          bool border) {
  const std::size_t contacts = static_cast<std::size_t>(rho.size());
  operations_ = 0.0;
  if (border && unknowns_ >= kLeastUnknowns && base_at_.size() == contacts && compare(free)) {
    if (border_ == 0 || formBorder(delassus, rho)) return true;
  }
  border_ = 0;
  unknowns_ = -1;
  const Unknowns n = count(free);
  for (double regularization = kFirstRegularization; regularization < 1.0; regularization *= 100.0) {
    operations_ += factorCost(n, static_cast<double>(delassus.rows()));
    if (!factorize(delassus, rho, free, regularization)) continue;
    unknowns_ = static_cast<int>(n.stick + n.slip);
    regularization_ = regularization;
    if (unknowns_ >= kLeastUnknowns) {
      base_ = free;
      base_at_.resize(contacts);
      free_at_.resize(contacts);
      whereContactsAre(base_, base_at_);
    }
    return true;
  }
  return false;
}

/// The blocks of the system,  [S, R; L^T, V]  with the sticking contacts' rows and columns first (there B = C = 1):
///   S = W + epsilon rho,   R = W B,   L = W C (W is symmetric),   V = C^T (W + epsilon rho) B + curvature.
struct StateFactor::Blocks {
  MapX stick, right, left, slip;
};

/// Cholesky of the sticking rows, S = G G^T, LU of the rest's Schur complement V - L^T S^-1 R. Leaves G^-1 R and G^-1
/// L.
bool StateFactor::factorize(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                            double regularization) {
  const Unknowns unknowns = count(free);
  const Eigen::Index ns = unknowns.stick, nv = unknowns.slip;
  stick_unknowns_ = static_cast<int>(ns);
  blocks_ = ns + nv > kSmall;
  if (!blocks_) return factorizeWhole(delassus, rho, free, regularization);
  grow(stick_matrix_, ns * ns);
  grow(right_, ns * nv);
  grow(left_, ns * nv);
  grow(slip_matrix_, nv * nv);
  Blocks blocks{
      {stick_matrix_.data(), ns, ns}, {right_.data(), ns, nv}, {left_.data(), ns, nv}, {slip_matrix_.data(), nv, nv}};
  formBlocks(delassus, rho, free, regularization, blocks);
  if (ns > 0 && !choleskyInPlace(blocks.stick)) return false;
  if (nv == 0) return true;
  if (ns > 0) eliminateSticking(blocks);
  return luInPlace(blocks.slip, pivots_);
}

void StateFactor::formBlocks(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                             double regularization, Blocks& blocks) {
  constexpr int kParts = 8;
  const Eigen::Index rows = delassus.rows();
  grow(column_, 2 * kParts * rows);
  tests_.clear();
  for (const FreeDirections& f : free) {
    if (f.dims < 3) tests_.push_back({3 * f.contact, f.dims == 2, {f.c(1, 1), f.c(2, 1)}});
  }
  parallelRanges(kParts, static_cast<int>(free.size()), [&](int begin, int end, int part) {
    double* workspace = column_.data() + 2 * part * rows;
    Eigen::Map<VecX> moved(workspace, rows), tested(workspace + rows, rows);
    for (int k = begin; k < end; ++k) {
      const FreeDirections& j = free[static_cast<std::size_t>(k)];
      if (j.dims < 3) {
        formSlipColumns(delassus, rho, free, regularization, j, moved, tested, blocks);
        continue;
      }
      for (const FreeDirections& i : free) {
        if (i.dims != 3) break;
        blocks.stick.block<3, 3>(i.offset, j.offset) = delassus.block<3, 3>(3 * i.contact, 3 * j.contact);
      }
      blocks.stick.diagonal().segment<3>(j.offset).array() += regularization * rho[j.contact];
    }
  });
}

/// Columns of R, L and V for contact j, which does not stick.
/// @param moved, tested  workspace: W times a column of b and of c
void StateFactor::formSlipColumns(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                                  double regularization, const FreeDirections& j, Eigen::Map<VecX>& moved,
                                  Eigen::Map<VecX>& tested, Blocks& blocks) const {
  const bool any_stick = stick_unknowns_ > 0;
  for (int d = 0; d < j.dims; ++d) {
    const Eigen::Index column = j.offset + d;
    moved = delassus.middleCols<3>(3 * j.contact).lazyProduct(j.b.col(d));
    if (any_stick) tested = delassus.middleCols<3>(3 * j.contact).lazyProduct(j.c.col(d));
    for (const FreeDirections& i : free) {
      if (i.dims != 3) break;
      blocks.right.block<3, 1>(i.offset, column) = moved.segment<3>(3 * i.contact);
      blocks.left.block<3, 1>(i.offset, column) = tested.segment<3>(3 * i.contact);
    }
    double* out = blocks.slip.col(column).data();
    for (const Test& i : tests_) {
      const double* w = &moved[i.row];
      *out++ = w[0];
      if (i.tangential) *out++ = i.tangent[0] * w[1] + i.tangent[1] * w[2];
    }
    blocks.slip(column, column) += regularization * rho[j.contact] + (d == 1 ? j.curvature : 0.0);
  }
}

/// R <- G^-1 R, L <- G^-1 L, V <- V - L^T R.
void StateFactor::eliminateSticking(Blocks& blocks) {
  const int columns = static_cast<int>(blocks.slip.cols()), parts = 1 + (columns - 1) / static_cast<int>(kPartColumns);
  parallelFor(2 * parts, [&](int part) {
    const int begin = partBegin(part % parts, parts, columns), end = partBegin(part % parts + 1, parts, columns);
    solveLowerInPlace(blocks.stick, (part < parts ? blocks.right : blocks.left).middleCols(begin, end - begin));
  });
  parallelRanges(parts, columns, [&](int begin, int end) {
    blocks.slip.middleCols(begin, end - begin).noalias() -=
        blocks.left.transpose() * blocks.right.middleCols(begin, end - begin);
  });
}

/// One LU, where there are few unknowns.
bool StateFactor::factorizeWhole(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                                 double regularization) {
  const Eigen::Index rows = delassus.rows();
  const Unknowns unknowns = count(free);
  const Eigen::Index n = unknowns.stick + unknowns.slip;
  grow(slip_matrix_, n * n);
  grow(column_, rows);
  MapX whole(slip_matrix_.data(), n, n);
  Eigen::Map<VecX> moved(column_.data(), rows);
  for (const FreeDirections& j : free) {
    for (int d = 0; d < j.dims; ++d) {
      const Eigen::Index column = row(j) + d;
      moved = delassus.middleCols<3>(3 * j.contact).lazyProduct(j.b.col(d));
      for (const FreeDirections& i : free) {
        const double* w = &moved[3 * i.contact];
        double* out = &whole(row(i), column);
        out[0] = w[0];
        if (i.dims == 2) out[1] = i.c(1, 1) * w[1] + i.c(2, 1) * w[2];
        if (i.dims == 3) out[1] = w[1], out[2] = w[2];
      }
      whole(column, column) += regularization * rho[j.contact] + (d == 1 ? j.curvature : 0.0);
    }
  }
  return luInPlace(whole, pivots_);
}

/// Solves with base_'s factor, in place.
template <typename Columns>
void StateFactor::solveBase(Columns& columns) const {
  const Eigen::Index ns = blocks_ ? stick_unknowns_ : 0, nv = columns.rows() - ns;
  const Eigen::Map<const MatX> stick(stick_matrix_.data(), ns, ns), right(right_.data(), ns, nv),
      left(left_.data(), ns, nv), slip(slip_matrix_.data(), nv, nv);
  auto sticking = columns.topRows(ns);
  auto slipping = columns.bottomRows(nv);
  if (ns > 0) stick.triangularView<Eigen::Lower>().solveInPlace(sticking);
  if (nv > 0) {
    if (ns > 0) slipping.noalias() -= left.transpose() * sticking;
    if constexpr (Columns::ColsAtCompileTime == 1) {
      luSolve(slip, pivots_, slipping);
    } else {
      luSolveColumns(slip, pivots_, slipping);
    }
    if (ns > 0) sticking.noalias() -= right * slipping;
  }
  if (ns > 0) stick.transpose().triangularView<Eigen::Upper>().solveInPlace(sticking);
}

/// The border that leads from base_ to `free`; false if it would not be worth it.
bool StateFactor::compare(const std::vector<FreeDirections>& free) {
  impulses_.clear();
  velocities_.clear();
  whereContactsAre(free, free_at_);
  const double n = unknowns_;
  const double dear = kWorthBordering * factorCost(count(free), 3.0 * static_cast<double>(base_at_.size()));
  for (std::size_t i = 0; i < base_at_.size(); ++i) {
    const int was = base_at_[i], is = free_at_[i];
    if (was < 0 && is < 0) continue;
    const FreeDirections& before = was < 0 ? kOpen : base_[static_cast<std::size_t>(was)];
    const FreeDirections& now = is < 0 ? kOpen : free[static_cast<std::size_t>(is)];
    if (before.dims == now.dims && before.b == now.b && before.c == now.c) continue;
    const auto list = [&](const Mat3& old_columns, const Mat3& new_columns, std::vector<Direction>& lost,
                          std::vector<Direction>& gained) {
      const Span a = spanOf(old_columns, before.dims), b = spanOf(new_columns, now.dims);
      const Span both = intersection(a, b);
      forRest(a, both, [&](const Vec3& v) { lost.push_back({static_cast<int>(i), was, v}); });
      forRest(b, both, [&](const Vec3& v) { gained.push_back({static_cast<int>(i), -1, v}); });
    };
    // an impulse lost is a row that holds it at zero, a velocity lost a column that lets it be anything
    list(before.b, now.b, velocities_, impulses_);
    list(before.c, now.c, impulses_, velocities_);
    const double k = static_cast<double>(impulses_.size());
    if (borderCost(n, k) > dear) return false;
  }
  border_ = static_cast<Eigen::Index>(impulses_.size());
  return impulses_.size() == velocities_.size();
}

/// Columns, rows and Schur complement of the border:  [C^T W B, U; V^T, Z].
bool StateFactor::formBorder(const Matrix& delassus, const VecX& rho) {
  const Eigen::Index n = unknowns_, k = border_, rows = delassus.rows();
  grow(border_columns_, n * k);
  grow(border_rows_, n * k);
  grow(schur_, k * k);
  grow(border_rhs_, k);
  grow(column_, rows);
  MapX columns(border_columns_.data(), n, k), held(border_rows_.data(), n, k), schur(schur_.data(), k, k);
  Eigen::Map<VecX> moved(column_.data(), rows);
  // Column i of `out`: what base_'s directions (c or b) see of a gained direction's response, regularized, which is
  // left in `moved`; of a lost one itself.
  const auto fill = [&](MapX& out, Eigen::Index i, const Direction& of, const Mat3 FreeDirections::*directions) {
    if (of.base >= 0) {
      const FreeDirections& f = base_[static_cast<std::size_t>(of.base)];
      out.col(i).setZero();
      out.col(i).segment(row(f), f.dims) = (f.*directions).leftCols(f.dims).transpose() * of.along;
      return;
    }
    moved = delassus.middleCols<3>(3 * of.contact).lazyProduct(of.along);
    moved.segment<3>(3 * of.contact) += regularization_ * rho[of.contact] * of.along;
    for (const FreeDirections& f : base_) {
      const Vec3 w = moved.segment<3>(3 * f.contact);
      for (int d = 0; d < f.dims; ++d) out(row(f) + d, i) = (f.*directions).col(d).dot(w);
    }
  };
  for (Eigen::Index i = 0; i < k; ++i) {
    fill(held, i, velocities_[static_cast<std::size_t>(i)], &FreeDirections::b);
    const Direction& impulse = impulses_[static_cast<std::size_t>(i)];
    fill(columns, i, impulse, &FreeDirections::c);
    for (Eigen::Index v = 0; v < k; ++v) {
      const Direction& velocity = velocities_[static_cast<std::size_t>(v)];
      const bool gained = impulse.base < 0 && velocity.base < 0;
      schur(v, i) = gained ? velocity.along.dot(moved.segment<3>(3 * velocity.contact)) : 0.0;
    }
  }
  const int parts = 1 + static_cast<int>((k - 1) / kPartColumns);
  parallelRanges(parts, static_cast<int>(k), [&](int begin, int end) {
    auto own = columns.middleCols(begin, end - begin);
    solveBase(own);
    schur.middleCols(begin, end - begin).noalias() -= held.transpose() * own;
  });
  operations_ += borderCost(static_cast<double>(n), static_cast<double>(k));
  return luInPlace(schur, border_pivots_);
}

void StateFactor::solve(const std::vector<FreeDirections>& free, const VecX& velocity, VecX& change) {
  const std::vector<FreeDirections>& solved = border_ > 0 ? base_ : free;
  grow(rhs_, velocity.size());
  Eigen::Map<VecX> rhs(rhs_.data(), unknowns_), extra(border_rhs_.data(), border_);
  for (const FreeDirections& f : solved) {
    const Vec3 v = velocity.segment<3>(3 * f.contact);
    for (int d = 0; d < f.dims; ++d) rhs[row(f) + d] = -f.c.col(d).dot(v);
  }
  solveBase(rhs);
  change.setZero(velocity.size());
  if (border_ > 0) {
    const Eigen::Map<const MatX> columns(border_columns_.data(), unknowns_, border_),
        held(border_rows_.data(), unknowns_, border_), schur(schur_.data(), border_, border_);
    for (Eigen::Index i = 0; i < border_; ++i) {
      const Direction& d = velocities_[static_cast<std::size_t>(i)];
      extra[i] = d.base >= 0 ? 0.0 : -d.along.dot(velocity.segment<3>(3 * d.contact));
    }
    extra.noalias() -= held.transpose() * rhs;
    luSolve(schur, border_pivots_, extra);
    rhs.noalias() -= columns * extra;
    for (Eigen::Index j = 0; j < border_; ++j) {
      const Direction& d = impulses_[static_cast<std::size_t>(j)];
      if (d.base < 0) change.segment<3>(3 * d.contact) += extra[j] * d.along;
    }
  }
  for (const FreeDirections& f : solved) {
    for (int d = 0; d < f.dims; ++d) change.segment<3>(3 * f.contact) += rhs[row(f) + d] * f.b.col(d);
  }
}

}  // namespace palpate
