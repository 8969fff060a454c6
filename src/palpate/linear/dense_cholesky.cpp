#include "palpate/linear/dense_cholesky.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "palpate/common/parallel.h"

namespace palpate {

bool choleskyInPlace(Eigen::Ref<MatX> a) {
  constexpr Eigen::Index kPanelColumns = 96;
  const Eigen::Index n = a.rows();
  for (Eigen::Index first = 0; first < n; first += kPanelColumns) {
    const Eigen::Index width = std::min(kPanelColumns, n - first), end = first + width;
    Eigen::Ref<MatX> own = a.block(first, first, width, width);
    const Eigen::LLT<Eigen::Ref<MatX>> in_place(own);
    if (in_place.info() != Eigen::Success) return false;
    const int chunks = static_cast<int>((n - end + kPanelColumns - 1) / kPanelColumns);
    parallelFor(chunks, [&](int chunk) {
      const Eigen::Index row = end + chunk * kPanelColumns, rows = std::min(kPanelColumns, n - row);
      auto below = a.block(row, first, rows, width);
      own.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(below);
    });
    parallelFor(chunks, [&](int chunk) {
      const Eigen::Index column = end + chunk * kPanelColumns, columns = std::min(kPanelColumns, n - column);
      a.block(column, column, n - column, columns).noalias() -=
          a.block(column, first, n - column, width) * a.block(column, first, columns, width).transpose();
    });
  }
  return true;
}

}  // namespace palpate
