#include "palpate/friction/reduced_contacts.h"

#include "palpate/linear/dense_cholesky.h"
#include "palpate/linear/triangular_solve.h"

namespace palpate {
namespace {

using MapX = Eigen::Map<MatX>;

constexpr double kRegularization = 1e-9;  // of rho: contacts that stick may be redundant

}  // namespace

bool ReducedContacts::form(const ContactProblem& whole, const VecX& rho, const VecX& lambda) {
  const Eigen::Index s = stickingRows(), d = doubtfulRows();
  cone_ = whole.cone;
  grow(factor_, s * s);
  grow(coupling_, s * d);
  grow(matrix_, d * d);
  MapX factor(factor_.data(), s, s), coupling(coupling_.data(), s, d), matrix(matrix_.data(), d, d);
  gatherBlocks(whole, sticking, sticking, factor);
  gatherBlocks(whole, sticking, doubtful, coupling);
  gatherBlocks(whole, doubtful, doubtful, matrix);
  contactVelocity(whole, lambda, shares_, velocity_);
  rest_.resize(s);
  for (std::size_t k = 0; k < sticking.size(); ++k) {
    const auto at = static_cast<Eigen::Index>(3 * k);
    factor.diagonal().segment<3>(at).array() += kRegularization * rho[sticking[k]];
    rest_.segment<3>(at) = velocity_.segment<3>(3 * sticking[k]);
    rest_[at] -= whole.bias[sticking[k]];
  }
  free_.resize(d);
  bias_.resize(d / 3);
  friction_.resize(d / 3);
  for (std::size_t k = 0; k < doubtful.size(); ++k) {
    free_.segment<3>(static_cast<Eigen::Index>(3 * k)) = velocity_.segment<3>(3 * doubtful[k]);
    bias_[static_cast<Eigen::Index>(k)] = whole.bias[doubtful[k]];
    friction_[static_cast<Eigen::Index>(k)] = whole.friction[doubtful[k]];
  }
  if (s == 0) return true;
  if (!choleskyInPlace(factor)) return false;
  solveLowerInPlace(factor, coupling);
  factor.triangularView<Eigen::Lower>().solveInPlace(rest_);
  matrix.noalias() -= coupling.transpose() * coupling;
  free_.noalias() -= coupling.transpose() * rest_;
  return true;
}

ContactProblem ReducedContacts::problem() const {
  const Eigen::Map<const MatX> matrix(matrix_.data(), doubtfulRows(), doubtfulRows());
  return {matrix, free_, bias_, friction_, cone_};
}

void ReducedContacts::expand(const VecX& own, VecX& lambda) {
  const Eigen::Index s = stickingRows();
  const MapX factor(factor_.data(), s, s), coupling(coupling_.data(), s, doubtfulRows());
  rest_.noalias() += coupling * own;
  factor.triangularView<Eigen::Lower>().transpose().solveInPlace(rest_);
  for (std::size_t k = 0; k < sticking.size(); ++k) {
    lambda.segment<3>(3 * sticking[k]) -= rest_.segment<3>(static_cast<Eigen::Index>(3 * k));
  }
  for (std::size_t k = 0; k < doubtful.size(); ++k) {
    lambda.segment<3>(3 * doubtful[k]) = own.segment<3>(static_cast<Eigen::Index>(3 * k));
  }
}

double ReducedContacts::operations() const {
  const auto s = static_cast<double>(stickingRows()), d = static_cast<double>(doubtfulRows());
  return s * (s * s / 3.0 + s * d + d * d);
}

}  // namespace palpate
