#include "palpate/solver/dense_lu.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate {

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

}  // namespace palpate
