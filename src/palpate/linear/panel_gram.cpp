#include "palpate/linear/panel_gram.h"

#include <algorithm>
#include <numeric>

#include "palpate/common/parallel.h"
#include "palpate/linear/triangular_solve.h"

namespace palpate {
namespace {

using Map = Eigen::Map<MatX>;
using ConstStrided = Eigen::Map<const MatX, 0, Eigen::OuterStride<>>;

constexpr int kPartColumns = 32;          // contacts of a part
constexpr Eigen::Index kMany = 128;       // contacts whose products are collected
constexpr double kMostOf = 0.6;           // of all contacts: others' rows are collected as zeros
constexpr Eigen::Index kCollected = 192;  // rows

}  // namespace

void PanelGram::setStructure(const PanelFactor& panels) {
  const int count = static_cast<int>(panels.panels().size());
  std::vector<std::vector<int>> children(count + 1);
  for (int s = count; s-- > 0;) children[panels.parent(s) < 0 ? count : panels.parent(s)].push_back(s);
  visit_.clear();
  std::vector<int> pending = children[count];
  while (!pending.empty()) {  // parents first, then turned round
    const int s = pending.back();
    pending.pop_back();
    visit_.push_back(s);
    pending.insert(pending.end(), children[s].begin(), children[s].end());
  }
  std::reverse(visit_.begin(), visit_.end());
  rank_.resize(count);
  for (int k = 0; k < count; ++k) rank_[visit_[k]] = k;
  reach_.resize(count);
  mark_.assign(count, -1);
  row_of_.resize(panels.nodes());
}

// Sorted by the panel that they begin in, as columns of one subtree then mostly lie together and their products need no
// scattering.
void PanelGram::findReach(const PanelFactor& panels, const std::vector<int>& position, const BlockColumns& columns) {
  const int count = columns.size();
  key_.assign(count, 0);
  for (int c = 0; c < count; ++c) {
    int first = static_cast<int>(visit_.size());
    for (int k = columns.begin[c]; k < columns.begin[c + 1]; ++k) {
      first = std::min(first, rank_[panels.panelOf(position[columns.node[k]])]);
    }
    key_[c] = first;
  }
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0);
  std::sort(order_.begin(), order_.end(), [&](int a, int b) { return std::pair(key_[a], a) < std::pair(key_[b], b); });
  place_.resize(count);
  for (auto& list : reach_) list.clear();
  std::fill(mark_.begin(), mark_.end(), -1);
  for (int c = 0; c < count; ++c) {
    place_[order_[c]] = c;
    for (int k = columns.begin[order_[c]]; k < columns.begin[order_[c] + 1]; ++k) {
      int s = panels.panelOf(position[columns.node[k]]);
      for (; s >= 0 && mark_[s] != c; s = panels.parent(s)) {
        mark_[s] = c;
        reach_[s].push_back(c);
      }
    }
  }
}

std::size_t PanelGram::stackTop() const { return waiting_.empty() ? 0 : waiting_.back().offset + waiting_.back().size; }

// What the columns [begin, end) of those that reach panel s have in its own rows.
void PanelGram::addOwnBlocks(const PanelFactor::Panel& panel, const std::vector<int>& reach, int begin, int end,
                             const BlockColumns& columns, const std::vector<int>& position, Map& front) const {
  for (int j = begin; j < end; ++j) {
    const int c = order_[reach[j]];
    for (int k = columns.begin[c]; k < columns.begin[c + 1]; ++k) {
      const int node = position[columns.node[k]];
      if (node < panel.first || node >= panel.first + panel.columns) continue;
      front.block<3, 3>(3 * (node - panel.first), 3 * j) += columns.block[k];
    }
  }
}

// What a child left for its parent's rows, in the columns [begin, end) of those that reach the parent.
void PanelGram::addFromChild(const PanelFactor& panels, const Waiting& waiting, const std::vector<int>& reach,
                             int begin, int end, Map& front) const {
  const PanelFactor::Panel& child = panels.panels()[waiting.panel];
  const int* rows = panels.rows().data() + child.row_begin + child.columns;
  const int height = child.rows - child.columns;
  const std::vector<int>& from_reach = reach_[waiting.panel];
  auto from_column = std::lower_bound(from_reach.begin(), from_reach.end(), reach[begin]);
  const double* from = stack_.data() + waiting.offset + 9 * height * (from_column - from_reach.begin());
  auto at = reach.begin() + begin;
  for (; from_column != from_reach.end() && *from_column <= reach[end - 1]; ++from_column) {
    at = std::lower_bound(at, reach.begin() + end, *from_column);
    for (int d = 0; d < 3; ++d, from += 3 * height) {
      double* to = front.col(3 * (at - reach.begin()) + d).data();
      for (int r = 0; r < height; ++r) {
        double* entry = to + 3 * row_of_[rows[r]];
        entry[0] += from[3 * r];
        entry[1] += from[3 * r + 1];
        entry[2] += from[3 * r + 2];
      }
    }
  }
}

// Right-hand sides at a panel's rows, its own and what its children leave there, and what they become by the panel's
// columns of L. On top of the stack, after what the children left.
void PanelGram::solveFront(const PanelFactor& panels, const double* values, int s, const BlockColumns& columns,
                           const std::vector<int>& position, Map& front) {
  const PanelFactor::Panel& panel = panels.panels()[s];
  const Eigen::Index own = 3 * panel.columns, below = front.rows() - own;
  const std::vector<int>& reach = reach_[s];
  const int* rows = panels.rows().data() + panel.row_begin;
  for (int r = 0; r < panel.rows; ++r) row_of_[rows[r]] = r;
  std::size_t first_child = waiting_.size();
  while (first_child > 0 && panels.parent(waiting_[first_child - 1].panel) == s) --first_child;
  const int count = static_cast<int>(reach.size()), parts = 1 + (count - 1) / kPartColumns;
  const ConstStrided l(values + panel.value, own + below, own, Eigen::OuterStride<>(panel.stride));
  parallelRanges(parts, count, [&](int begin, int end) {
    auto mine = front.middleCols(3 * begin, 3 * (end - begin));
    mine.setZero();
    addOwnBlocks(panel, reach, begin, end, columns, position, front);
    for (std::size_t w = waiting_.size(); w-- > first_child;) {
      addFromChild(panels, waiting_[w], reach, begin, end, front);
    }
    solveLowerInPlace(l.topRows(own), mine.topRows(own));
    if (below > 0) mine.bottomRows(below).noalias() -= l.bottomRows(below) * mine.topRows(own);
  });
  waiting_.resize(first_child);
}

// Keeps a front's rows below its panel where its children's began.
void PanelGram::leaveToParent(int panel, const Map& front, Eigen::Index below) {
  if (below == 0) return;
  const std::size_t offset = stackTop();
  double* to = stack_.data() + offset;
  for (Eigen::Index j = 0; j < front.cols(); ++j) {
    const double* from = front.data() + j * front.rows() + (front.rows() - below);
    std::copy(from, from + below, to + j * below);
  }
  waiting_.push_back({panel, offset, static_cast<std::size_t>(below * front.cols())});
}

namespace {

// Lower triangle of out += half^T half, by tiles.
void addGram(const Eigen::Ref<const MatX>& half, Eigen::Ref<MatX> out) {
  constexpr Eigen::Index kTile = 192;
  const Eigen::Index width = half.cols();
  parallelFor(static_cast<int>((width + kTile - 1) / kTile), [&](int tile) {
    const Eigen::Index begin = tile * kTile, own = std::min(kTile, width - begin), below = width - begin - own;
    const auto columns = half.middleCols(begin, own);
    out.block(begin, begin, own, own).selfadjointView<Eigen::Lower>().rankUpdate(columns.transpose());
    if (below > 0) {
      out.block(begin + own, begin, below, own).noalias() += half.rightCols(below).transpose() * columns;
    }
  });
}

}  // namespace

// Half^T half at its place among the sorted columns.
void PanelGram::addProducts(const Eigen::Ref<const MatX>& half, const std::vector<int>& reach) {
  const Eigen::Index width = half.cols();
  if (reach.back() - reach.front() + 1 == static_cast<int>(reach.size())) {
    addGram(half, sorted_.block(3 * reach.front(), 3 * reach.front(), width, width));
    return;
  }
  product_.setZero(width, width);
  addGram(half, product_);
  const auto count = static_cast<Eigen::Index>(reach.size());
  for (Eigen::Index j = 0; j < count; ++j) {
    for (Eigen::Index i = j; i < count;) {  // runs of columns that lie together
      Eigen::Index end = i + 1;
      while (end < count && reach[end] == reach[end - 1] + 1) ++end;
      sorted_.block(3 * reach[i], 3 * reach[j], 3 * (end - i), 3) += product_.block(3 * i, 3 * j, 3 * (end - i), 3);
      i = end;
    }
  }
}

// Few rows under many columns: adding their products would mostly be reading and writing the sum.
void PanelGram::collect(const Eigen::Ref<const MatX>& half, const std::vector<int>& reach) {
  if (collected_rows_ + half.rows() > kCollected) addCollected();
  collected_.resize(kCollected, sorted_.cols());
  auto rows = collected_.middleRows(collected_rows_, half.rows());
  rows.setZero();
  for (std::size_t j = 0; j < reach.size(); ++j) {
    rows.middleCols<3>(3 * reach[j]) = half.middleCols<3>(static_cast<Eigen::Index>(3 * j));
  }
  collected_rows_ += half.rows();
}

void PanelGram::addCollected() {
  if (collected_rows_ > 0) addGram(collected_.topRows(collected_rows_), sorted_);
  collected_rows_ = 0;
}

// The products of the sorted columns, in the order that they were given in.
void PanelGram::unsort(MatX& out) const {
  const int count = static_cast<int>(place_.size());
  parallelRanges(1 + (count - 1) / kPartColumns, count, [&](int begin, int end) {
    for (int j = begin; j < end; ++j) {
      const Eigen::Index column = place_[j];
      for (Eigen::Index i = j; i < count; ++i) {
        const Eigen::Index row = place_[i];
        if (row > column) {
          out.block<3, 3>(3 * i, 3 * j) = sorted_.block<3, 3>(3 * row, 3 * column);
        } else if (row < column) {
          out.block<3, 3>(3 * i, 3 * j) = sorted_.block<3, 3>(3 * column, 3 * row).transpose();
        } else {
          out.block<3, 3>(3 * i, 3 * j).triangularView<Eigen::Lower>() = sorted_.block<3, 3>(3 * row, 3 * row);
        }
      }
    }
  });
}

void PanelGram::compute(const PanelFactor& panels, const double* values, const std::vector<int>& position,
                        const BlockColumns& columns, MatX& out) {
  const Eigen::Index size = columns.size();
  findReach(panels, position, columns);
  sorted_.resize(3 * size, 3 * size);
  const int count = static_cast<int>(size);
  parallelRanges(1 + (count - 1) / kPartColumns, count, [&](int begin, int end) {
    for (int j = 3 * begin; j < 3 * end; ++j) sorted_.col(j).tail(3 * size - j).setZero();
  });
  waiting_.clear();
  collected_rows_ = 0;
  for (const int s : visit_) {
    if (reach_[s].empty()) continue;
    const PanelFactor::Panel& panel = panels.panels()[s];
    const Eigen::Index own = 3 * panel.columns, below = 3 * (panel.rows - panel.columns);
    const auto reached = static_cast<Eigen::Index>(reach_[s].size()), width = 3 * reached;
    const std::size_t top = stackTop();
    grow(stack_, static_cast<Eigen::Index>(top) + (own + below) * width);
    Map front(stack_.data() + top, own + below, width);
    solveFront(panels, values, s, columns, position, front);
    if (reached >= kMany && own <= kCollected / 2 &&
        kMostOf * static_cast<double>(size) < static_cast<double>(reached)) {
      collect(front.topRows(own), reach_[s]);
    } else {
      addProducts(front.topRows(own), reach_[s]);
    }
    leaveToParent(s, front, below);
  }
  addCollected();
  unsort(out);
}

double PanelGram::operations(const PanelFactor& panels, const std::vector<int>& nodes) {
  std::vector<double> width(panels.panels().size(), 0.0);
  for (const int node : nodes) width[panels.panelOf(node)] += 3.0;
  double sum = 0;
  for (const int s : visit_) {
    const PanelFactor::Panel& panel = panels.panels()[s];
    const double own = 3.0 * panel.columns, below = 3.0 * (panel.rows - panel.columns);
    sum += width[s] * own * (own + 2.0 * below + width[s]);
    if (panels.parent(s) >= 0) width[panels.parent(s)] += width[s];
  }
  return sum;
}

}  // namespace palpate
