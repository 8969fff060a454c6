#include "palpate/linear/panel_gram.h"

#include <algorithm>
#include <numeric>

#include "palpate/common/parallel.h"
#include "palpate/linear/triangular_solve.h"

namespace palpate {
namespace {

using Map = Eigen::Map<MatX>;
using ConstStrided = Eigen::Map<const MatX, 0, Eigen::OuterStride<>>;

constexpr int kLeast = 16;        // contacts that are worth several parts
constexpr int kPartColumns = 32;  // contacts of a part, at most (unless there are kMostParts)
constexpr int kMostParts = 128;   // more pairs would be more than a loop may have parts
constexpr int kUnsorted = 32;     // the same where they are only copied

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

// Parts of like size, an even number, as most machines have that many cores.
void PanelGram::makeParts(const PanelFactor& panels, int columns) {
  part_count_ = columns < kLeast ? 1 : std::min(kMostParts, 2 * (1 + (columns - 1) / (2 * kPartColumns)));
  if (parts_.size() < static_cast<std::size_t>(part_count_)) parts_.resize(part_count_);
  for (int p = 0; p < part_count_; ++p) {
    Part& part = parts_[p];
    part.columns = {partBegin(p, part_count_, columns), partBegin(p + 1, part_count_, columns)};
    part.waiting.clear();
    part.row_of.resize(panels.nodes());
  }
  const auto partOf = [&](int column) {
    int p = 0;
    while (column >= parts_[p].columns.end) ++p;
    return p;
  };
  shared_.clear();
  half_at_.assign(reach_.size(), 0);
  std::size_t size = 0;
  for (const int s : visit_) {
    if (reach_[s].empty() || partOf(reach_[s].front()) == partOf(reach_[s].back())) continue;
    shared_.push_back(s);
    half_at_[s] = size;
    size += 9 * reach_[s].size() * panels.panels()[s].columns;
  }
  grow(halves_, static_cast<Eigen::Index>(size));
}

// Each pair of parts in two halves.
void PanelGram::makeTiles() {
  tile_count_ = part_count_ * (part_count_ - 1);
  if (tiles_.size() < static_cast<std::size_t>(tile_count_)) tiles_.resize(tile_count_);
  int count = 0;
  for (int p = 0; p < part_count_; ++p) {
    const auto [begin, end] = parts_[p].columns;
    const int middle = (begin + end) / 2;
    for (int later = p + 1; later < part_count_; ++later) {
      for (const Range half : {Range{begin, middle}, Range{middle, end}}) {
        tiles_[count].later = later;
        tiles_[count++].columns = half;
      }
    }
  }
}

// Where those of the sorted columns that reach a panel are in its list.
PanelGram::Range PanelGram::reached(int panel, Range columns) const {
  const auto& list = reach_[panel];
  const auto first = std::lower_bound(list.begin(), list.end(), columns.begin);
  const auto last = std::lower_bound(first, list.end(), columns.end);
  return {static_cast<int>(first - list.begin()), static_cast<int>(last - list.begin())};
}

// What columns that reach panel s have in its own rows.
void PanelGram::addOwnBlocks(const Factor& f, int s, Range reach, Map& front) const {
  const PanelFactor::Panel& panel = f.panels.panels()[s];
  for (int j = 0; j < reach.size(); ++j) {
    const int c = order_[reach_[s][reach.begin + j]];
    for (int k = f.columns.begin[c]; k < f.columns.begin[c + 1]; ++k) {
      const int node = f.position[f.columns.node[k]];
      if (node < panel.first || node >= panel.first + panel.columns) continue;
      front.block<3, 3>(3 * (node - panel.first), 3 * j) += f.columns.block[k];
    }
  }
}

// What a child left for its parent's rows, in a part's columns; `reach`: of the parent.
void PanelGram::addFromChild(const Factor& f, const Part& part, const Waiting& waiting, Range reach, Map& front) const {
  const PanelFactor::Panel& child = f.panels.panels()[waiting.panel];
  const int* rows = f.panels.rows().data() + child.row_begin + child.columns;
  const int height = child.rows - child.columns;
  const Range from_reach = reached(waiting.panel, part.columns);
  const double* from = part.stack.data() + waiting.offset;
  const auto& list = reach_[f.panels.parent(waiting.panel)];
  int at = reach.begin;
  for (int i = from_reach.begin; i < from_reach.end; ++i) {
    while (list[at] < reach_[waiting.panel][i]) ++at;
    for (int d = 0; d < 3; ++d, from += 3 * height) {
      double* to = front.col(3 * (at - reach.begin) + d).data();
      for (int r = 0; r < height; ++r) {
        double* entry = to + 3 * part.row_of[rows[r]];
        entry[0] += from[3 * r];
        entry[1] += from[3 * r + 1];
        entry[2] += from[3 * r + 2];
      }
    }
  }
}

// Right-hand sides at a panel's rows, its own and what its children leave there, and what they become by the panel's
// columns of L. On top of the stack, after what the children left.
void PanelGram::solveFront(const Factor& f, int s, Range reach, Part& part, Map& front) const {
  const PanelFactor::Panel& panel = f.panels.panels()[s];
  const Eigen::Index own = 3 * panel.columns, below = front.rows() - own;
  const int* rows = f.panels.rows().data() + panel.row_begin;
  for (int r = 0; r < panel.rows; ++r) part.row_of[rows[r]] = r;
  front.setZero();
  addOwnBlocks(f, s, reach, front);
  while (!part.waiting.empty() && f.panels.parent(part.waiting.back().panel) == s) {
    addFromChild(f, part, part.waiting.back(), reach, front);
    part.waiting.pop_back();
  }
  const ConstStrided l(f.values + panel.value, own + below, own, Eigen::OuterStride<>(panel.stride));
  solveLowerInPlace(l.topRows(own), front.topRows(own));
  if (below > 0) front.bottomRows(below).noalias() -= l.bottomRows(below) * front.topRows(own);
}

// Keeps a front's rows below its panel where its children's began.
void PanelGram::leaveToParent(int panel, const Map& front, Eigen::Index below, Part& part) {
  if (below == 0) return;
  const std::size_t offset = part.stackTop();
  double* to = part.stack.data() + offset;
  for (Eigen::Index j = 0; j < front.cols(); ++j) {
    const double* from = front.data() + j * front.rows() + (front.rows() - below);
    std::copy(from, from + below, to + j * below);
  }
  part.waiting.push_back({panel, offset, static_cast<std::size_t>(below * front.cols())});
}

// A panel's rows of Y, for the products with other parts' columns.
void PanelGram::keepHalf(int panel, Range reach, const Eigen::Ref<const MatX>& half) {
  if (static_cast<std::size_t>(reach.size()) == reach_[panel].size()) return;
  double* to = halves_.data() + half_at_[panel] + static_cast<std::size_t>(3 * reach.begin * half.rows());
  Map(to, half.rows(), half.cols()) = half;
}

// A part's columns through the tree, and its products with itself.
void PanelGram::descend(const Factor& f, Part& part) {
  const auto [begin, end] = part.columns;
  for (int j = 3 * begin; j < 3 * end; ++j) sorted_.col(j).segment(j, 3 * end - j).setZero();
  for (const int s : visit_) {
    const Range reach = reached(s, part.columns);
    if (reach.size() == 0) continue;
    const PanelFactor::Panel& panel = f.panels.panels()[s];
    const Eigen::Index own = 3 * panel.columns, below = 3 * (panel.rows - panel.columns), width = 3 * reach.size();
    const std::size_t top = part.stackTop();
    grow(part.stack, static_cast<Eigen::Index>(top) + (own + below) * width);
    Map front(part.stack.data() + top, own + below, width);
    solveFront(f, s, reach, part, front);
    keepHalf(s, reach, front.topRows(own));
    addProducts(s, reach, front.topRows(own), part.product);
    leaveToParent(s, front, below, part);
  }
}

namespace {

bool together(const std::vector<int>& list, int begin, int end) {
  return list[end - 1] - list[begin] == end - 1 - begin;
}

}  // namespace

// Adds products of columns that reach a panel, right ones by left ones, where they are among all: in runs of columns
// that lie together, and only what is in the lower triangle.
void PanelGram::scatter(int panel, Range left, Range right, const MatX& product) {
  const auto& list = reach_[panel];
  for (int j = left.begin; j < left.end; ++j) {
    for (int i = std::max(right.begin, j); i < right.end;) {
      int next = i + 1;
      while (next < right.end && list[next] == list[next - 1] + 1) ++next;
      sorted_.block(3 * list[i], 3 * list[j], 3 * (next - i), 3) +=
          product.block(3 * (i - right.begin), 3 * (j - left.begin), 3 * (next - i), 3);
      i = next;
    }
  }
}

// Half^T half at its place among the sorted columns, lower triangle.
void PanelGram::addProducts(int panel, Range reach, const Eigen::Ref<const MatX>& half, MatX& product) {
  const auto& list = reach_[panel];
  const Eigen::Index width = half.cols();
  if (together(list, reach.begin, reach.end)) {
    sorted_.block(3 * list[reach.begin], 3 * list[reach.begin], width, width)
        .selfadjointView<Eigen::Lower>()
        .rankUpdate(half.transpose());
    return;
  }
  product.setZero(width, width);
  product.selfadjointView<Eigen::Lower>().rankUpdate(half.transpose());
  scatter(panel, reach, reach, product);
}

// Products of two parts' columns.
void PanelGram::multiply(const PanelFactor& panels, Tile& tile) {
  const Range below = parts_[tile.later].columns;
  sorted_.block(3 * below.begin, 3 * tile.columns.begin, 3 * below.size(), 3 * tile.columns.size()).setZero();
  for (const int s : shared_) {
    const Range left = reached(s, tile.columns), right = reached(s, below);
    if (left.size() == 0 || right.size() == 0) continue;
    const auto& list = reach_[s];
    const Eigen::Index own = 3 * panels.panels()[s].columns;
    const auto half = [&](Range r) {
      return Eigen::Map<const MatX>(halves_.data() + half_at_[s] + static_cast<std::size_t>(3 * r.begin * own), own,
                                    3 * r.size());
    };
    if (together(list, left.begin, left.end) && together(list, right.begin, right.end)) {
      sorted_.block(3 * list[right.begin], 3 * list[left.begin], 3 * right.size(), 3 * left.size()).noalias() +=
          half(right).transpose() * half(left);
      continue;
    }
    tile.product.resize(3 * right.size(), 3 * left.size());
    tile.product.noalias() = half(right).transpose() * half(left);
    scatter(s, left, right, tile.product);
  }
}

// The products of the sorted columns, in the order that they were given in.
void PanelGram::unsort(MatX& out) const {
  const int count = static_cast<int>(place_.size());
  parallelRanges(1 + (count - 1) / kUnsorted, count, [&](int begin, int end) {
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
  findReach(panels, position, columns);
  sorted_.resize(3 * columns.size(), 3 * columns.size());
  makeParts(panels, columns.size());
  makeTiles();
  const Factor factor{panels, values, position, columns};
  parallelFor(part_count_, [&](int p) { descend(factor, parts_[p]); });
  parallelFor(tile_count_, [&](int t) { multiply(panels, tiles_[t]); });
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
