#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Cholesky factor in supernodal form: neighbouring block columns of like structure share a dense column-major panel.
/// Its rows are nodes, the panel's own columns first; nodes are numbered in the order of elimination. Factorizes panels
/// that hold the matrix (small problems), and solves with panels from whichever source.
class PanelFactor {
 public:
  struct Panel {
    int first = 0;          ///< first node column
    int columns = 0;        ///< number of node columns
    int rows = 0;           ///< number of node rows, columns included
    int row_begin = 0;      ///< of its rows in rows()
    std::size_t value = 0;  ///< of its first entry in the values
    int stride = 0;         ///< from one scalar column to the next
  };

  /// Panels in order of their columns; `rows`: node of each panel row, ascending within a panel.
  void setStructure(std::vector<Panel> panels, std::vector<int> rows);
  /// Precomputes where each panel's updates go; needed by factorize() only. Moves the panels' values apart.
  void planUpdates();

  /// Turns panels of P A P^T (lower triangle; what the pattern lacks is zero) into those of L. False if a pivot is not
  /// positive or not finite. Needs kPadding readable doubles behind the values.
  bool factorize(double* values);
  /// Inverts the diagonal of a factor that was computed elsewhere; false if it is not positive and finite.
  bool invertDiagonal(const double* values);

  /// x <- L^-1 x and x <- L^-T x from panel `begin` on (forward), or down to panel 0 (backward), on a row-major block
  /// of W right-hand sides [3 nodes x W], W one of 1, 4, 8 and 16. `active`: panels to visit, all if empty. With one
  /// right-hand side, panels of a large factor that planUpdates() has dealt out are visited part by part, which
  /// parallelFor() runs; the result does not depend on threads.
  template <int W>
  void forward(const double* values, double* x, int begin, std::span<const char> active = {}) const;
  template <int W>
  void backward(const double* values, double* x, std::span<const char> active = {}) const;

  const std::vector<Panel>& panels() const { return panels_; }
  const std::vector<int>& rows() const { return rows_; }
  int panelOf(int node) const { return panel_of_[node]; }
  /// Panel that the rows below this one start in, or -1.
  int parent(int panel) const;
  int nodes() const { return static_cast<int>(panel_of_.size()); }
  std::size_t valueCount() const { return value_count_; }

  static constexpr std::size_t kPadding = 64;

 private:
  /// Panel `source` reduces the target's columns rows[first..last) of the source; destination of source row r (from
  /// `first`) is target row map_[map + r - first].
  struct Update {
    int source, first, last, map;
  };

  struct Room {                 // of a part, for single right-hand sides
    std::vector<double> below;  // rows below a panel
    std::vector<double> dots;   // columns of a panel
    std::vector<double> top;    // what the part takes off the columns of top_
  };
  struct Forest;
  double ownWork(int panel) const;
  static std::vector<int> splitSubtrees(const Forest& forest, std::vector<char>& on_top);
  void planParts();
  void planTop();
  void applyUpdates(double* values, int panel, int first_column, int last_column, std::vector<double>& product);
  bool factorizePanel(double* values, int panel, std::vector<double>& product);
  bool factorizeOnTop(double* values, int panel);
  bool inParts() const { return parts_.size() > 1 && value_count_ >= kLeastInParts; }
  void forwardBelow(const double* values, int panel, const double* x, int begin, int end, double* sum) const;
  void forwardOf(const double* values, int panel, Room& room, double* x, double* top) const;
  void backwardBelow(const double* values, int panel, const double* below_x, int begin, int end, double* dots) const;
  void backwardOf(const double* values, int panel, Room& room, double* x) const;

  std::vector<Panel> panels_;
  std::vector<int> rows_;
  std::vector<int> panel_of_;
  std::size_t value_count_ = 0;
  std::vector<Update> updates_;    // grouped by target
  std::vector<int> update_begin_;  // [panels + 1]
  std::vector<int> map_;
  std::vector<std::vector<int>> parts_;  // panels of whole subtrees, which need nothing of each other
  std::vector<int> top_;                 // the others, which come after them
  static constexpr int kMostParts = 16;
  static constexpr std::size_t kLeastInParts = 100'000;  // entries; one right-hand side then takes some 100 us
  std::vector<double> inverse_diagonal_;
  std::vector<std::vector<double>> products_;  // 3 columns of one update, for each part
  std::vector<int> top_place_;                 // of a node among the columns of top_, -1
  mutable std::vector<Room> rooms_;            // of each part
};

}  // namespace palpate
