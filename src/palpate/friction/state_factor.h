#pragma once

#include <vector>

#include "palpate/linear/aligned_buffer.h"
#include "palpate/math/types.h"

namespace palpate {

/// What the state of a closed contact leaves free: directions of the impulse (columns of b) and the velocities that
/// vanish there (columns of c, orthonormal). The columns of each are orthogonal, and c^T b = 1. Unless the contact
/// sticks, c's first column is the normal (the first axis), and its second, if there is one, a tangent.
struct FreeDirections {
  int contact = 0;
  int dims = 0;    ///< 1 to 3; 3: sticks, b and c are the identity
  int offset = 0;  ///< first unknown among those of the sticking contacts, or among the others'
  Mat3 b = Mat3::Zero();
  Mat3 c = Mat3::Zero();
  double curvature = 0.0;  ///< [1/kg] turning of the friction direction on the exact cone: |w_t| / (mu lambda_n)
};

/// Factor of the system that given states of the contacts leave (docs/contact-solver.md):
///   C^T ((W + epsilon rho) lambda + v) = 0,   lambda in the span of B
/// for the change of impulses lambda that takes the velocities v away. Where only a few contacts changed their states
/// since the last factorization, that factor is bordered with the directions that went and came instead
/// (Sherman-Morrison-Woodbury): n^2 k operations for k of them in place of n^3.
/// It owns its workspace, which grows on demand and is reused.
class StateFactor {
 public:
  /// The next prepare() factorizes whatever the states: W is another one.
  void forget() { unknowns_ = -1; }
  /// @param delassus  W [1/kg], symmetric, 3m x 3m
  /// @param rho       [m] impulse times this compares with velocity [1/kg]
  /// @param free      of the closed contacts, sticking ones first; b and c as they were at the last factorization for a
  ///                  contact that keeps its state
  /// @param border    whether the last factor may be bordered; no curvature then
  /// @return false if there is no factor, with epsilon up to 0.1 (1e-9 as a rule)
  bool prepare(const Eigen::Ref<const MatX>& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
               bool border);
  /// Whether the last prepare() bordered an earlier factor. Its solutions have more rounding in them.
  bool bordered() const { return border_ > 0; }
  /// What the last prepare() came to, in operations.
  double operations() const { return operations_; }
  /// @param free      as given to prepare(); on the exact cone c may have turned since
  /// @param velocity  v [m/s], 3m
  /// @param change    lambda [N s], 3m, out
  void solve(const std::vector<FreeDirections>& free, const VecX& velocity, VecX& change);

 private:
  // aligned, as Eigen's vectors are: otherwise the heap decides how sums are split, and the last bits with it
  using Matrix = Eigen::Ref<const MatX>;
  /// A direction that a contact's state lost (an impulse held at zero, a velocity let go) or gained.
  struct Direction {
    int contact = 0;
    int base = -1;  ///< where the contact is in base_ if the direction was lost, or -1: gained
    Vec3 along = Vec3::Zero();
  };

  /// The columns of c of a contact that does not stick, close together.
  struct Test {
    int row = 0;
    bool tangential = false;
    double tangent[2] = {};
  };

  struct Blocks;

  bool factorize(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                 double regularization);
  void formBlocks(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                  double regularization, Blocks& blocks);
  void formSlipColumns(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                       double regularization, const FreeDirections& j, Eigen::Map<VecX>& moved,
                       Eigen::Map<VecX>& tested, Blocks& blocks) const;
  static void eliminateSticking(Blocks& blocks);
  bool factorizeWhole(const Matrix& delassus, const VecX& rho, const std::vector<FreeDirections>& free,
                      double regularization);
  bool compare(const std::vector<FreeDirections>& free);
  bool formBorder(const Matrix& delassus, const VecX& rho);
  template <typename Columns>
  void solveBase(Columns& columns) const;
  Eigen::Index row(const FreeDirections& f) const { return f.dims == 3 ? f.offset : stick_unknowns_ + f.offset; }

  std::vector<FreeDirections> base_;  ///< what was factorized
  int unknowns_ = -1;                 ///< of base_; -1: nothing is factorized
  int stick_unknowns_ = 0;
  bool blocks_ = false;  ///< a Cholesky factor of the sticking rows and an LU of the rest's Schur complement, or one LU
  double regularization_ = 0.0;
  double operations_ = 0.0;
  AlignedBuffer stick_matrix_, right_, left_, slip_matrix_, column_;  ///< factor of base_'s system, by blocks
  std::vector<Test> tests_;
  std::vector<int> pivots_;

  Eigen::Index border_ = 0;
  std::vector<int> base_at_, free_at_;            ///< [m] where a contact is in base_ and in free, or -1
  std::vector<Direction> impulses_, velocities_;  ///< [k] the border's columns and rows
  AlignedBuffer border_columns_, border_rows_, schur_, rhs_, border_rhs_;
  std::vector<int> border_pivots_;
};

}  // namespace palpate
