#pragma once

#include <vector>

#include "palpate/linear/aligned_buffer.h"
#include "palpate/linear/panel_factor.h"
#include "palpate/math/types.h"

namespace palpate {

/// Columns of a matrix [3 nodes x 3 size()], three at a time, by their 3x3 blocks that are not zero.
struct BlockColumns {
  std::vector<int> begin{0};  ///< [size() + 1] of each triple of columns in node and block
  std::vector<int> node;      ///< block row
  std::vector<Mat3> block;

  int size() const { return static_cast<int>(begin.size()) - 1; }
  void clear() {
    begin.assign(1, 0);
    node.clear();
    block.clear();
  }
  void add(int n, const Mat3& b) {
    node.push_back(n);
    block.push_back(b);
  }
  /// Ends the present triple of columns.
  void close() { begin.push_back(static_cast<int>(node.size())); }
};

/// R^T A^-1 R from the panels of A's Cholesky factor, for sparse columns R: Y = L^-1 P R, then Y^T Y, panel by panel
/// and in dense blocks, with those columns alone that reach a panel (a column reaches the panels on its nodes' ways to
/// the root of the elimination tree). Owns its workspace.
class PanelGram {
 public:
  /// Order in which the panels are visited; whenever the factor's structure has changed.
  void setStructure(const PanelFactor& panels);
  /// Lower triangle of `out` = R^T A^-1 R, [3 columns.size()] square; the upper one is left as it is.
  /// @param values    panels of the factor
  /// @param position  of a node in the factor's order
  void compute(const PanelFactor& panels, const double* values, const std::vector<int>& position,
               const BlockColumns& columns, MatX& out);
  /// Operations that compute() takes for one contact on each of the given nodes of the factor's order.
  double operations(const PanelFactor& panels, const std::vector<int>& nodes);

 private:
  void findReach(const PanelFactor& panels, const std::vector<int>& position, const BlockColumns& columns);
  struct Waiting {  // what a panel leaves to its parent: rows below it x columns that reach it
    int panel;
    std::size_t offset, size;
  };
  std::size_t stackTop() const;
  void addOwnBlocks(const PanelFactor::Panel& panel, const std::vector<int>& reach, int begin, int end,
                    const BlockColumns& columns, const std::vector<int>& position, Eigen::Map<MatX>& front) const;
  void addFromChild(const PanelFactor& panels, const Waiting& waiting, const std::vector<int>& reach, int begin,
                    int end, Eigen::Map<MatX>& front) const;
  void solveFront(const PanelFactor& panels, const double* values, int panel, const BlockColumns& columns,
                  const std::vector<int>& position, Eigen::Map<MatX>& front);
  void leaveToParent(int panel, const Eigen::Map<MatX>& front, Eigen::Index below);
  void addProducts(const Eigen::Ref<const MatX>& half, const std::vector<int>& reach);
  void collect(const Eigen::Ref<const MatX>& half, const std::vector<int>& reach);
  void addCollected();
  void unsort(MatX& out) const;

  std::vector<int> visit_;                // panels, children before their parents and whole subtrees together
  std::vector<int> rank_;                 // of a panel in visit_
  std::vector<std::vector<int>> reach_;   // of each panel: columns, as places in order_, increasing
  std::vector<int> order_, place_, key_;  // columns sorted by where they begin; the reverse
  std::vector<int> mark_;
  std::vector<Waiting> waiting_;
  // aligned, as Eigen's matrices are: otherwise the heap decides how sums are split, and the last bits with it
  AlignedBuffer stack_;
  std::vector<int> row_of_;
  MatX sorted_, product_;
  MatX collected_;  // rows of panels that most columns reach, whose products are added together
  Eigen::Index collected_rows_ = 0;
};

}  // namespace palpate
