// The factorization beside general-purpose libraries, its solves, and four ways to form W = J A^-1 J^T.

#include "palpate/linear/sparse_cholesky.h"

#include <benchmark/benchmark.h>

#include <Eigen/Cholesky>
#include <Eigen/IterativeLinearSolvers>
#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "factorization_baseline.h"
#include "shared/lattice_matrices.h"

namespace palpate::bench {
namespace {

using namespace test;

using Numeric = SparseCholesky::Numeric;

enum Problem { kThinLimbed, kBar288, kBar2592, kBar10140 };

const LatticeMatrix& problem(int which) {
  static const LatticeMatrix problems[] = {thinLimbedMatrix(), barMatrix(4, 3, 4), barMatrix(8, 6, 9),
                                           barMatrix(13, 10, 13)};
  return problems[which];
}

void describe(benchmark::State& state, const SparseCholesky& cholesky, const LatticeMatrix& lattice) {
  const auto& s = cholesky.statistics();
  state.SetLabel(std::to_string(lattice.tetrahedra) + " tetrahedra, " + s.ordering + ", " + s.numeric);
  state.counters["dof"] = s.dof;
  state.counters["last"] = s.last;
  state.counters["nonzeros"] = static_cast<double>(s.nonzeros);
  state.counters["Mflop"] = s.flops / 1e6;
}

std::span<const int> lastNodes(const LatticeMatrix& lattice, bool wanted) {
  return wanted ? std::span<const int>(lattice.bottom) : std::span<const int>();
}

void sparseCholeskyFactorize(benchmark::State& state) {
  const LatticeMatrix& lattice = problem(static_cast<int>(state.range(0)));
  SparseCholesky cholesky;
  cholesky.analyze(lattice.matrix, lastNodes(lattice, state.range(1) != 0), static_cast<Numeric>(state.range(2)));
  for (auto _ : state) benchmark::DoNotOptimize(cholesky.factorize(lattice.matrix));
  describe(state, cholesky, lattice);
}
BENCHMARK(sparseCholeskyFactorize)
    ->ArgNames({"problem", "contact_last", "numeric"})
    ->ArgsProduct({{kThinLimbed, kBar288, kBar2592, kBar10140},
                   {0, 1},
                   {static_cast<int>(Numeric::compact), static_cast<int>(Numeric::cholmod)}})
    ->Unit(benchmark::kMicrosecond);

void sparseCholeskyBaseline(benchmark::State& state) {
  const LatticeMatrix& lattice = problem(static_cast<int>(state.range(0)));
  FactorizationBaseline baseline;
  for (auto _ : state) baseline = measureFactorizationBaseline(lattice.matrix, state.range(0) < kBar2592 ? 200 : 7);
  state.SetLabel(std::to_string(lattice.tetrahedra) + " tetrahedra; the counters are what counts");
  state.counters["eigen_llt_us"] = baseline.eigen_llt_us;
  state.counters["eigen_ldlt_us"] = baseline.eigen_ldlt_us;
  state.counters["cholmod_us"] = baseline.cholmod_us;
}
BENCHMARK(sparseCholeskyBaseline)
    ->ArgName("problem")
    ->DenseRange(kThinLimbed, kBar10140)
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

void sparseCholeskySolve(benchmark::State& state) {
  const LatticeMatrix& lattice = problem(static_cast<int>(state.range(0)));
  SparseCholesky cholesky;
  cholesky.analyze(lattice.matrix, lattice.bottom);
  cholesky.factorize(lattice.matrix);
  MatX x = MatX::Ones(3 * lattice.matrix.size, state.range(1));
  const MatX rhs = x;
  for (auto _ : state) {
    x = rhs;
    cholesky.solve(x);
    benchmark::DoNotOptimize(x.data());
  }
  describe(state, cholesky, lattice);
}
BENCHMARK(sparseCholeskySolve)
    ->ArgNames({"problem", "columns"})
    ->ArgsProduct({{kThinLimbed, kBar288, kBar2592, kBar10140}, {1, 6, 12, 120}})
    ->Unit(benchmark::kMicrosecond);

void sparseCholeskySolveFromTrailing(benchmark::State& state) {
  const LatticeMatrix& lattice = problem(static_cast<int>(state.range(0)));
  SparseCholesky cholesky;
  cholesky.analyze(lattice.matrix, lattice.bottom);
  cholesky.factorize(lattice.matrix);
  const MatX r = MatX::Ones(cholesky.statistics().last, 1);
  MatX x(3 * lattice.matrix.size, 1);
  for (auto _ : state) {
    cholesky.solveFromTrailing(r, x);
    benchmark::DoNotOptimize(x.data());
  }
  describe(state, cholesky, lattice);
}
BENCHMARK(sparseCholeskySolveFromTrailing)
    ->ArgName("problem")
    ->DenseRange(kThinLimbed, kBar10140)
    ->Unit(benchmark::kMicrosecond);

/// Contact rows of points on faces of the bottom layer: three rows a contact, each on three random bottom nodes. J^T is
/// returned for all freedoms, its part on the bottom nodes (in their order) in `condensed`.
MatX contactRows(const LatticeMatrix& lattice, int contacts, MatX& condensed) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0.1, 1.0);
  const auto last = static_cast<int>(lattice.bottom.size());
  MatX full = MatX::Zero(3 * lattice.matrix.size, 3 * contacts);
  condensed = MatX::Zero(3 * last, 3 * contacts);
  for (int c = 0; c < contacts; ++c) {
    for (int v = 0; v < 3; ++v) {
      const int k = static_cast<int>(random() % static_cast<unsigned>(last));
      const Mat3 weight = uniform(random) * Mat3::Identity();
      condensed.block<3, 3>(3 * k, 3 * c) += weight;
      full.block<3, 3>(3 * lattice.bottom[static_cast<std::size_t>(k)], 3 * c) += weight;
    }
  }
  return full;
}

enum Way { kFullSolves, kHalfSolves, kTrailing, kConjugateGradients };

/// One conjugate-gradient solve a row, with the diagonal as preconditioner, to a relative residual of 1e-8.
MatX delassusByConjugateGradients(const Eigen::SparseMatrix<double>& a, const MatX& jt) {
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower | Eigen::Upper> solver;
  solver.setTolerance(1e-8);
  solver.compute(a);
  MatX x(jt.rows(), jt.cols());
  for (Eigen::Index c = 0; c < jt.cols(); ++c) x.col(c) = solver.solve(jt.col(c));
  return jt.transpose() * x;
}

Eigen::SparseMatrix<double> scalarMatrix(const SymmetricBlockMatrix& matrix) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < matrix.size; ++j)
    for (int slot = matrix.column[j]; slot < matrix.column[j + 1]; ++slot)
      for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) {
          entries.emplace_back(3 * matrix.row[slot] + r, 3 * j + c, matrix.block(slot)(r, c));
          if (matrix.row[slot] != j)
            entries.emplace_back(3 * j + c, 3 * matrix.row[slot] + r, matrix.block(slot)(r, c));
        }
  Eigen::SparseMatrix<double> a(3 * matrix.size, 3 * matrix.size);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

/// Numeric factorization and W, from given values. `error`: against the trailing block's W, relative.
void formDelassus(benchmark::State& state) {
  const LatticeMatrix& lattice = problem(static_cast<int>(state.range(0)));
  const auto way = static_cast<Way>(state.range(2));
  MatX condensed;
  const MatX jt = contactRows(lattice, static_cast<int>(state.range(1)), condensed);
  const Eigen::SparseMatrix<double> scalar = scalarMatrix(lattice.matrix);
  SparseCholesky cholesky;
  cholesky.analyze(lattice.matrix, lastNodes(lattice, way == kTrailing));

  const auto fromTrailing = [&](SparseCholesky& factor) -> MatX {
    factor.factorize(lattice.matrix);
    const MatX y = factor.trailing().triangularView<Eigen::Lower>().solve(condensed);
    MatX w = MatX::Zero(y.cols(), y.cols());
    w.selfadjointView<Eigen::Lower>().rankUpdate(y.transpose());
    return w;
  };
  MatX w;
  for (auto _ : state) {
    if (way == kTrailing) {
      w = fromTrailing(cholesky);
    } else if (way == kConjugateGradients) {
      w = delassusByConjugateGradients(scalar, jt);
    } else {
      cholesky.factorize(lattice.matrix);
      MatX y = jt;
      if (way == kHalfSolves) {
        cholesky.halfSolve(y);
        w.setZero(y.cols(), y.cols());
        w.selfadjointView<Eigen::Lower>().rankUpdate(y.transpose());
      } else {
        cholesky.solve(y);
        w.noalias() = jt.transpose() * y;
      }
    }
    benchmark::DoNotOptimize(w.data());
  }

  static const char* const names[] = {"solves", "half solves", "trailing block", "conjugate gradients"};
  state.SetLabel(std::to_string(lattice.tetrahedra) + " tetrahedra, " + names[way]);
  SparseCholesky reference;
  reference.analyze(lattice.matrix, lattice.bottom);
  const MatX exact = fromTrailing(reference);
  state.counters["error"] =
      MatX((w - exact).triangularView<Eigen::Lower>()).norm() / MatX(exact.triangularView<Eigen::Lower>()).norm();
}
BENCHMARK(formDelassus)
    ->ArgNames({"problem", "contacts", "way"})
    ->ArgsProduct({{kBar288, kBar2592, kBar10140},
                   {25, 75, 200},
                   {kFullSolves, kHalfSolves, kTrailing, kConjugateGradients}})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate::bench
