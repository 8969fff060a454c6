#include "factorization_baseline.h"

#include <cholmod.h>
#include <dlfcn.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <chrono>
#include <limits>
#include <stdexcept>
#include <vector>

namespace palpate::bench {
namespace {

using SparseMatrix = Eigen::SparseMatrix<double>;

SparseMatrix lowerTriangle(const SymmetricBlockMatrix& matrix) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < matrix.size; ++j)
    for (int slot = matrix.column[j]; slot < matrix.column[j + 1]; ++slot)
      for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r)
          if (3 * matrix.row[slot] + r >= 3 * j + c)
            entries.emplace_back(3 * matrix.row[slot] + r, 3 * j + c, matrix.block(slot)(r, c));
  SparseMatrix lower(3 * matrix.size, 3 * matrix.size);
  lower.setFromTriplets(entries.begin(), entries.end());
  return lower;
}

template <typename Function>
double medianMicroseconds(int repetitions, const Function& function) {
  using Clock = std::chrono::steady_clock;
  std::vector<double> times;
  function();
  for (int i = 0; i < std::max(1, repetitions); ++i) {
    const auto begin = Clock::now();
    function();
    times.push_back(std::chrono::duration<double, std::micro>(Clock::now() - begin).count());
  }
  std::nth_element(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2), times.end());
  return times[times.size() / 2];
}

template <typename Solver>
double eigenMicroseconds(const SparseMatrix& lower, int repetitions) {
  Solver solver;
  solver.analyzePattern(lower);
  const double time = medianMicroseconds(repetitions, [&] { solver.factorize(lower); });
  if (solver.info() != Eigen::Success) throw std::runtime_error("the baseline's matrix is not positive definite");
  return time;
}

/// As fast as CHOLMOD gets: its parallel loops, which Debian's build runs with four threads, are kept on this one.
double cholmodMicroseconds(SparseMatrix& lower, int mode, int repetitions) {
  const auto set_levels = reinterpret_cast<void (*)(int)>(dlsym(RTLD_DEFAULT, "omp_set_max_active_levels"));
  const auto get_levels = reinterpret_cast<int (*)()>(dlsym(RTLD_DEFAULT, "omp_get_max_active_levels"));
  const int levels = get_levels != nullptr ? get_levels() : 0;
  if (set_levels != nullptr) set_levels(0);

  cholmod_common common;
  cholmod_start(&common);
  common.supernodal = mode;
  cholmod_sparse matrix{};
  matrix.nrow = matrix.ncol = static_cast<std::size_t>(lower.rows());
  matrix.nzmax = static_cast<std::size_t>(lower.nonZeros());
  matrix.p = lower.outerIndexPtr();
  matrix.i = lower.innerIndexPtr();
  matrix.x = lower.valuePtr();
  matrix.stype = -1;
  matrix.itype = CHOLMOD_INT;
  matrix.xtype = CHOLMOD_REAL;
  matrix.dtype = CHOLMOD_DOUBLE;
  matrix.sorted = matrix.packed = 1;
  cholmod_factor* factor = cholmod_analyze(&matrix, &common);
  const double time = medianMicroseconds(repetitions, [&] { cholmod_factorize(&matrix, factor, &common); });
  cholmod_free_factor(&factor, &common);
  cholmod_finish(&common);
  if (set_levels != nullptr) set_levels(levels);
  return time;
}

}  // namespace

double FactorizationBaseline::fastest() const { return std::min({eigen_llt_us, eigen_ldlt_us, cholmod_us}); }

FactorizationBaseline measureFactorizationBaseline(const SymmetricBlockMatrix& matrix, int repetitions) {
  SparseMatrix lower = lowerTriangle(matrix);
  FactorizationBaseline baseline;
  baseline.eigen_llt_us = eigenMicroseconds<Eigen::SimplicialLLT<SparseMatrix>>(lower, repetitions);
  baseline.eigen_ldlt_us = eigenMicroseconds<Eigen::SimplicialLDLT<SparseMatrix>>(lower, repetitions);
  baseline.cholmod_us = std::min(cholmodMicroseconds(lower, CHOLMOD_SIMPLICIAL, repetitions),
                                 cholmodMicroseconds(lower, CHOLMOD_SUPERNODAL, repetitions));
  return baseline;
}

}  // namespace palpate::bench
