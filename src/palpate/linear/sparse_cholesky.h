#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "palpate/linear/panel_gram.h"
#include "palpate/linear/symmetric_block_matrix.h"
#include "palpate/math/types.h"

namespace palpate {

/// Sparse Cholesky factor P A P^T = L L^T of a symmetric block matrix, for a pattern that stays and values that change.
/// The nodes that contact may touch can be ordered last: then the trailing block L_cc of the factor is that of the
/// Schur complement, and for rows J that act on those nodes only, J A^-1 J^T = Y^T Y with Y = L_cc^-1 J_c^T.
///
/// CHOLMOD finds the ordering and the supernodes; its numeric factorization does the work for large problems, an own
/// one, which spares its overhead, for small ones (docs/sparse-factorization.md). An object must not be used by two
/// threads at once, but for solve(), gram() and between(), one of each. The results are the same to the bit on every
/// run on one machine. After analyze() and the first call of each kind, nothing here allocates, except that CHOLMOD's
/// factorization may.
class SparseCholesky {
 public:
  /// Which code does the numeric factorization; `automatic` chooses by the number of operations.
  enum class Numeric { automatic, compact, cholmod };

  struct Statistics {
    int dof = 0;                ///< rows of the matrix
    int last = 0;               ///< rows of the trailing block
    std::size_t nonzeros = 0;   ///< entries stored in L, explicit zeros of the supernodes included
    double flops = 0.0;         ///< operations of one numeric factorization, explicit zeros not counted
    double sought_flops = 0.0;  ///< those in the ordering that was sought
    int supernodes = 0;
    std::string
        ordering;  ///< the ordering that won: "camd", "amd", "metis", "nested-dissection" "natural" or "extended"
    std::string numeric;  ///< "compact" or "cholmod"
  };

  SparseCholesky();
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  /// Finds ordering and structure for all matrices with this pattern (the values are not read). `last_nodes`: the nodes
  /// of the trailing block, in its order; distinct. Throws std::invalid_argument if they are out of range or repeated.
  void analyze(const SymmetricBlockMatrix& pattern, std::span<const int> last_nodes = {},
               Numeric numeric = Numeric::automatic);
  /// The same with an ordering that was sought for the first `sought` of the last nodes, and the others moved to its
  /// end. Cheap where the last call had these first ones too, as it then need not be sought again; what comes out does
  /// not depend on that.
  void extend(const SymmetricBlockMatrix& pattern, std::span<const int> last_nodes, std::size_t sought,
              Numeric numeric = Numeric::automatic);

  /// Numeric factorization. False if the matrix is not positive definite or not finite; the factor is then not to be
  /// used. Throws std::invalid_argument if the pattern is not of the size that was analyzed.
  bool factorize(const SymmetricBlockMatrix& values);

  /// rhs <- A^-1 rhs; [3 nodes x any number of columns], in the caller's node order. Many columns are shared out among
  /// the calling thread's others, which takes memory once for as many.
  void solve(Eigen::Ref<MatX> rhs);
  /// rhs <- L^-1 P rhs, in the order of the factor; skips what stays zero. A^-1 = (L^-1 P)^T (L^-1 P).
  void halfSolve(Eigen::Ref<MatX> rhs);

  /// L_cc: lower triangle [3 last x 3 last] of the factor of the last nodes, in their order; the upper one is zero.
  const MatX& trailing() const;
  /// x = A^-1 E_c r for a right-hand side that acts on the last nodes only: r [3 last x columns] in their order,
  /// x [3 nodes x columns] in the caller's node order. Costs little more than half a solve().
  void solveFromTrailing(const Eigen::Ref<const MatX>& r, Eigen::Ref<MatX> x);

  /// Lower triangle of `out` = R^T A^-1 R for columns R that act on few nodes each, in the caller's node order; `out`
  /// gets the size [3 columns.size()] square, its upper triangle is left undefined. For rows on the last nodes
  /// trailing() is the faster way; this one needs no nodes ordered last, and so spares their fill.
  void gram(const BlockColumns& columns, MatX& out);
  /// `out` = Q^T A^-1 R [3 left.size() x 3 right.size()] for columns Q (left) and R (right) that act on few nodes each,
  /// in the caller's node order. Visits only what lies on these nodes' ways to the root of the elimination tree.
  void between(const BlockColumns& left, const BlockColumns& right, MatX& out);
  /// Operations that gram() takes for one contact, three columns, on each of the given nodes.
  double gramOperations(std::span<const int> nodes);

  const Statistics& statistics() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
