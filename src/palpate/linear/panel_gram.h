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
/// the root of the elimination tree). Parts of the columns go through the tree at the same time, and pairs of parts are
/// multiplied afterwards. Owns its workspace.
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
  struct Factor {
    const PanelFactor& panels;
    const double* values;
    const std::vector<int>& position;
    const BlockColumns& columns;
  };
  struct Range {
    int begin, end;
    int size() const { return end - begin; }
  };
  struct Waiting {  // what a panel leaves to its parent: rows below it x a part's columns that reach it
    int panel;
    std::size_t offset, size;
  };
  struct Part {  // of the sorted columns
    Range columns;
    std::vector<Waiting> waiting;
    // aligned, as Eigen's matrices are: otherwise the heap decides how sums are split, and the last bits with it
    AlignedBuffer stack;
    std::vector<int> row_of;
    MatX product;
    std::size_t stackTop() const { return waiting.empty() ? 0 : waiting.back().offset + waiting.back().size; }
  };
  struct Tile {  // some of a part's columns beside all of a later part's
    int later;
    Range columns;
    MatX product;
  };

  void findReach(const PanelFactor& panels, const std::vector<int>& position, const BlockColumns& columns);
  void makeParts(const PanelFactor& panels, int columns);
  void makeTiles();
  Range reached(int panel, Range columns) const;
  void addOwnBlocks(const Factor& f, int panel, Range reach, Eigen::Map<MatX>& front) const;
  void addFromChild(const Factor& f, const Part& part, const Waiting& waiting, Range reach,
                    Eigen::Map<MatX>& front) const;
  void solveFront(const Factor& f, int panel, Range reach, Part& part, Eigen::Map<MatX>& front) const;
  static void leaveToParent(int panel, const Eigen::Map<MatX>& front, Eigen::Index below, Part& part);
  void keepHalf(int panel, Range reach, const Eigen::Ref<const MatX>& half);
  void descend(const Factor& f, Part& part);
  void scatter(int panel, Range left, Range right, const MatX& product);
  void addProducts(int panel, Range reach, const Eigen::Ref<const MatX>& half, MatX& product);
  void multiply(const PanelFactor& panels, Tile& tile);
  void unsort(MatX& out) const;

  std::vector<int> visit_;                // panels, children before their parents and whole subtrees together
  std::vector<int> rank_;                 // of a panel in visit_
  std::vector<std::vector<int>> reach_;   // of each panel: columns, as places in order_, increasing
  std::vector<int> order_, place_, key_;  // columns sorted by where they begin; the reverse
  std::vector<int> mark_;
  std::vector<Part> parts_;
  std::vector<Tile> tiles_;
  int part_count_ = 0, tile_count_ = 0;  // the others are kept for their room
  std::vector<int> shared_;              // panels that several parts reach
  std::vector<std::size_t> half_at_;     // where their rows of Y are, of each panel
  AlignedBuffer halves_;
  MatX sorted_;
};

}  // namespace palpate
