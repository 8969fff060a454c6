#include "palpate/reduction/modes.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "palpate/math/decompositions.h"

namespace palpate {
namespace {

constexpr int kGuard = 2;  // vectors beyond those wanted
constexpr int kFirstSweeps = 12;
constexpr int kSweeps = 1;       // from the modes of the step before
constexpr double kStill = 0.05;  // of a mode, in the norm of A: by so little another would be better
constexpr double kLeast = 1.0;   // squared frequency [1/s^2]

// The columns of `start`, as far as there are any, then always the same for the same number of rows: smooth and rough
// ones that no symmetry of a body is blind to.
MatX firstBasis(Eigen::Index rows, Eigen::Index columns, const MatX& start) {
  const Eigen::Index given = start.rows() == rows ? std::min(columns, start.cols()) : 0;
  MatX out(rows, columns);
  if (given > 0) out.leftCols(given) = start.leftCols(given);
  for (Eigen::Index j = given; j < columns; ++j) {
    for (Eigen::Index i = 0; i < rows; ++i) {
      out(i, j) = std::sin(1.0 + 0.7 * static_cast<double>(j) +
                           (0.37 + 0.911 * static_cast<double>(j)) * static_cast<double>(i));
    }
  }
  return out;
}

// Of K against M, from eigenvalues of A.
VecX squaredFrequencies(const ModalProblem& problem, const VecX& values) {
  return ((values.array() - problem.s) / problem.e).max(kLeast).matrix();
}

// Ritz vectors of A in the space of these columns, if A M^-1 leads hardly out of it: none otherwise.
// @param columns  mass-normalized
std::optional<Modes> stillModes(const ModalProblem& problem, const MatX& columns) {
  constexpr Eigen::Index kAtOnce = 4;  // where some move, the first ones mostly tell
  const Eigen::Index count = columns.cols();
  const MatX momentum = problem.momentum(columns);
  const VecX diagonal = problem.matrix->diagonal();
  MatX a(count, count);
  for (Eigen::Index first = 0; first < count; first += kAtOnce) {
    const Eigen::Index some = std::min(kAtOnce, count - first);
    const MatX forces = problem.matrix->multiplyColumns(columns.middleCols(first, some));
    a.middleCols(first, some) = columns.transpose() * forces;
    const MatX left = forces - momentum * a.middleCols(first, some);
    for (Eigen::Index k = 0; k < some; ++k) {
      // about what the inverse would make of it, in the energy of A
      const double off = left.col(k).cwiseAbs2().cwiseQuotient(diagonal).sum();
      if (!(off < kStill * kStill * a(first + k, first + k))) return std::nullopt;
    }
  }
  const SymmetricEigen ritz = symmetricEigen(a, MatX(columns.transpose() * momentum));
  return Modes{columns * ritz.vectors, squaredFrequencies(problem, ritz.values)};
}

}  // namespace

Modes findModes(const ModalProblem& problem, const MatX& start, int count) {
  const Eigen::Index rows = problem.rows;
  const Eigen::Index wanted = std::min<Eigen::Index>(count, rows);
  const Eigen::Index columns = std::min<Eigen::Index>(wanted + kGuard, rows);
  if (wanted == 0) return {MatX(rows, 0), VecX(0)};
  const bool warm = start.rows() == rows && start.cols() > 0;
  if (warm && problem.matrix != nullptr && start.cols() == wanted) {
    if (std::optional<Modes> still = stillModes(problem, start)) return *std::move(still);
  }
  MatX x = firstBasis(rows, columns, start);
  Modes modes;
  for (int k = 0; k < (warm ? kSweeps : kFirstSweeps); ++k) {
    const MatX loads = problem.momentum(x);
    MatX y = loads;
    problem.solve(y);
    // Rayleigh-Ritz: y^T A y = y^T M x
    MatX a = y.transpose() * loads;
    MatX m = y.transpose() * problem.momentum(y);
    a = 0.5 * (a + a.transpose()).eval();
    m = 0.5 * (m + m.transpose()).eval();
    const SymmetricEigen ritz = symmetricEigen(a, m);
    x = y * ritz.vectors;
    modes.squared_frequency = squaredFrequencies(problem, ritz.values);
  }
  modes.shapes = x;
  return modes;
}

}  // namespace palpate
