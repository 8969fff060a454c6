#include "palpate/solver/panel_gram.h"

#include <algorithm>
#include <numeric>

#include "palpate/solver/triangular_solve.h"

namespace palpate {
namespace {

using Map = Eigen::Map<MatX>;
using ConstStrided = Eigen::Map<const MatX, 0, Eigen::OuterStride<>>;

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

// Right-hand sides at a panel's rows: its own, and what its children leave there. On top of the stack, behind what they
// left.
double* PanelGram::makeFront(const PanelFactor& panels, int s, const BlockColumns& columns,
                             const std::vector<int>& position) {
  const PanelFactor::Panel& panel = panels.panels()[s];
  const int* rows = panels.rows().data() + panel.row_begin;
  const std::vector<int>& reach = reach_[s];
  const Eigen::Index height = 3 * panel.rows, width = 3 * static_cast<Eigen::Index>(reach.size());
  std::size_t top = 0;
  if (!waiting_.empty()) {
    const PanelFactor::Panel& last = panels.panels()[waiting_.back().panel];
    top = waiting_.back().offset +
          9 * static_cast<std::size_t>(last.rows - last.columns) * reach_[waiting_.back().panel].size();
  }
  if (stack_.size() < top + static_cast<std::size_t>(height * width)) {
    stack_.resize(top + static_cast<std::size_t>(height * width));
  }
  Map front(stack_.data() + top, height, width);
  front.setZero();
  for (int r = 0; r < panel.rows; ++r) row_of_[rows[r]] = r;
  for (Eigen::Index j = 0; j < width / 3; ++j) {
    const int c = order_[reach[j]];
    for (int k = columns.begin[c]; k < columns.begin[c + 1]; ++k) {
      const int node = position[columns.node[k]];
      if (node < panel.first || node >= panel.first + panel.columns) continue;
      front.block<3, 3>(3 * (node - panel.first), 3 * j) += columns.block[k];
    }
  }
  while (!waiting_.empty() && panels.parent(waiting_.back().panel) == s) {
    const int child = waiting_.back().panel;
    const PanelFactor::Panel& below = panels.panels()[child];
    const int* child_rows = panels.rows().data() + below.row_begin + below.columns;
    const int child_height = below.rows - below.columns;
    const double* from = stack_.data() + waiting_.back().offset;
    auto at = reach.begin();
    for (const int c : reach_[child]) {
      at = std::lower_bound(at, reach.end(), c);
      for (int d = 0; d < 3; ++d, from += 3 * child_height) {
        double* to = front.col(3 * (at - reach.begin()) + d).data();
        for (int r = 0; r < child_height; ++r) {
          double* entry = to + 3 * row_of_[child_rows[r]];
          entry[0] += from[3 * r];
          entry[1] += from[3 * r + 1];
          entry[2] += from[3 * r + 2];
        }
      }
    }
    waiting_.pop_back();
  }
  return front.data();
}

// Half^T half at its place among the sorted columns.
void PanelGram::addProducts(const Eigen::Ref<const MatX>& half, const std::vector<int>& reach) {
  const Eigen::Index width = half.cols();
  if (reach.back() - reach.front() + 1 == static_cast<int>(reach.size())) {
    sorted_.block(3 * reach.front(), 3 * reach.front(), width, width)
        .selfadjointView<Eigen::Lower>()
        .rankUpdate(half.transpose());
    return;
  }
  product_.setZero(width, width);
  product_.selfadjointView<Eigen::Lower>().rankUpdate(half.transpose());
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

void PanelGram::compute(const PanelFactor& panels, const double* values, const std::vector<int>& position,
                        const BlockColumns& columns, MatX& out) {
  const Eigen::Index size = columns.size();
  findReach(panels, position, columns);
  sorted_.setZero(3 * size, 3 * size);
  waiting_.clear();
  for (const int s : visit_) {
    if (reach_[s].empty()) continue;
    const PanelFactor::Panel& panel = panels.panels()[s];
    const Eigen::Index own = 3 * panel.columns, below = 3 * (panel.rows - panel.columns);
    const auto width = 3 * static_cast<Eigen::Index>(reach_[s].size());
    double* front_data = makeFront(panels, s, columns, position);
    Map front(front_data, own + below, width);
    const ConstStrided l(values + panel.value, own + below, own, Eigen::OuterStride<>(panel.stride));
    solveLowerInPlace(l.topRows(own), front.topRows(own));
    if (below > 0) front.bottomRows(below).noalias() -= l.bottomRows(below) * front.topRows(own);
    addProducts(front.topRows(own), reach_[s]);
    if (below == 0) continue;
    // what is left goes where the children's began
    std::size_t offset = 0;
    if (!waiting_.empty()) {
      const PanelFactor::Panel& last = panels.panels()[waiting_.back().panel];
      offset = waiting_.back().offset +
               9 * static_cast<std::size_t>(last.rows - last.columns) * reach_[waiting_.back().panel].size();
    }
    double* to = stack_.data() + offset;
    for (Eigen::Index j = 0; j < width; ++j) {
      const double* from = front_data + j * (own + below) + own;
      std::copy(from, from + below, to + j * below);
    }
    waiting_.push_back({s, offset});
  }
  for (Eigen::Index j = 0; j < size; ++j) {
    const Eigen::Index column = place_[j];
    for (Eigen::Index i = j; i < size; ++i) {
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
