#include "palpate/linear/panel_factor.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "palpate/common/parallel.h"

namespace palpate {
namespace {

// As many doubles as one register holds, as the compiler's portable vector type. Wider types than the machine has are
// compiled into something twenty times slower.
#if defined(__AVX512F__)
constexpr int kLanes = 8;
#elif defined(__AVX__)
constexpr int kLanes = 4;
#else
constexpr int kLanes = 2;
#endif
typedef double Pack __attribute__((vector_size(kLanes * sizeof(double))));

inline void load(Pack& pack, const double* from) { std::memcpy(&pack, from, sizeof(Pack)); }
inline void store(double* to, const Pack& pack) { std::memcpy(to, &pack, sizeof(Pack)); }

/// c[3 columns of T packs of rows, column stride `c_stride`] = sum over k < depth of a(:, k) b(0..2, k)^T, a and b with
/// the same stride.
template <int T>
inline void productTile(const double* a, const double* b, int stride, int depth, double* c, int c_stride) {
  Pack sum[3][T] = {};
  for (int k = 0; k < depth; ++k, a += stride, b += stride) {
    for (int t = 0; t < T; ++t) {
      Pack rows;
      load(rows, a + kLanes * t);
      for (int j = 0; j < 3; ++j) sum[j][t] += rows * b[j];
    }
  }
  for (int j = 0; j < 3; ++j)
    for (int t = 0; t < T; ++t) store(c + j * c_stride + kLanes * t, sum[j][t]);
}

/// The same for any number of rows; writes and reads up to two packs more.
inline void product(const double* a, const double* b, int stride, int depth, int rows, double* c, int c_stride) {
  int r = 0;
  for (; rows - r > 2 * kLanes; r += 3 * kLanes) productTile<3>(a + r, b, stride, depth, c + r, c_stride);
  if (rows - r > kLanes) {
    productTile<2>(a + r, b, stride, depth, c + r, c_stride);
  } else if (rows - r > 0) {
    productTile<1>(a + r, b, stride, depth, c + r, c_stride);
  }
}

constexpr std::size_t kRoom = 16;  // doubles

inline bool isPivot(double d) { return d > 0.0 && d <= std::numeric_limits<double>::max(); }

}  // namespace

void PanelFactor::setStructure(std::vector<Panel> panels, std::vector<int> rows) {
  panels_ = std::move(panels);
  rows_ = std::move(rows);
  panel_of_.clear();
  value_count_ = 0;
  int most_rows = 0;
  for (std::size_t s = 0; s < panels_.size(); ++s) {
    const Panel& panel = panels_[s];
    panel_of_.insert(panel_of_.end(), panel.columns, static_cast<int>(s));
    value_count_ = std::max(value_count_, panel.value + static_cast<std::size_t>(panel.stride) * 3 * panel.columns);
    most_rows = std::max(most_rows, panel.rows);
  }
  inverse_diagonal_.assign(3 * panel_of_.size(), 0.0);
  products_.assign(1, std::vector<double>(3 * (3 * static_cast<std::size_t>(most_rows) + 24), 0.0));
  parts_.clear();
  top_.clear();
  const std::size_t room = 3 * static_cast<std::size_t>(most_rows) + 24;
  rooms_.assign(1, {std::vector<double>(room, 0.0), std::vector<double>(room, 0.0), {}});
  updates_.clear();
  update_begin_.clear();
  map_.clear();
}

int PanelFactor::parent(int panel) const {
  const Panel& p = panels_[panel];
  return p.rows > p.columns ? panel_of_[rows_[p.row_begin + p.columns]] : -1;
}

void PanelFactor::planUpdates() {
  // room between panels: packs read beyond a panel's end, where another thread may be writing
  value_count_ = 0;
  for (Panel& panel : panels_) {
    panel.value = value_count_;
    const std::size_t size = static_cast<std::size_t>(panel.stride) * 3 * panel.columns;
    value_count_ += (size / kRoom + 2) * kRoom;
  }
  std::vector<std::vector<Update>> by_target(panels_.size());
  std::vector<int> position(panel_of_.size());
  // sources in ascending order, target by target: the order of the sums is fixed
  for (std::size_t s = 0; s < panels_.size(); ++s) {
    const Panel& source = panels_[s];
    const int* rows = rows_.data() + source.row_begin;
    for (int first = source.columns; first < source.rows;) {
      const int target = panel_of_[rows[first]];
      int last = first;
      while (last < source.rows && panel_of_[rows[last]] == target) ++last;
      by_target[target].push_back({static_cast<int>(s), first, last, static_cast<int>(map_.size())});
      const Panel& t = panels_[target];
      for (int r = 0; r < t.rows; ++r) position[rows_[t.row_begin + r]] = r;
      for (int r = first; r < source.rows; ++r) map_.push_back(position[rows[r]]);
      first = last;
    }
  }
  update_begin_.assign(1, 0);
  for (const auto& list : by_target) {
    updates_.insert(updates_.end(), list.begin(), list.end());
    update_begin_.push_back(static_cast<int>(updates_.size()));
  }
  planParts();
}

// The elimination forest of the panels, with the operations that each subtree takes.
struct PanelFactor::Forest {
  std::vector<double> work;  // of each panel and all below it
  std::vector<std::vector<int>> children;
  std::vector<int> roots;

  explicit Forest(const PanelFactor& factor) : work(factor.panels_.size(), 0.0), children(work.size()) {
    for (std::size_t s = 0; s < work.size(); ++s) {  // children come before their parents
      const int panel = static_cast<int>(s), above = factor.parent(panel);
      work[s] += factor.ownWork(panel);
      if (above < 0) {
        roots.push_back(panel);
      } else {
        work[above] += work[s];
        children[above].push_back(panel);
      }
    }
  }
  bool less(int a, int b) const { return std::pair(work[a], a) < std::pair(work[b], b); }
};

// Operations of one panel's updates and factorization.
double PanelFactor::ownWork(int panel) const {
  const double width = 3.0 * panels_[panel].columns, height = 3.0 * panels_[panel].rows;
  double work = width * width * height;
  for (int u = update_begin_[panel]; u < update_begin_[panel + 1]; ++u) {
    const Panel& source = panels_[updates_[u].source];
    work += 18.0 * (updates_[u].last - updates_[u].first) * (source.rows - updates_[u].first) * 3.0 * source.columns;
  }
  return work;
}

// Splits the largest subtrees until none is more than a small share of the work; what remains of them, largest first.
// Marks the panels above.
std::vector<int> PanelFactor::splitSubtrees(const Forest& forest, std::vector<char>& on_top) {
  constexpr double kWorthwhile = 1e6;  // operations; some 50 us
  constexpr double kShare = 0.1;
  std::vector<int> trees = forest.roots;
  double total = 0;
  for (const int s : trees) total += forest.work[s];
  const auto less = [&](int a, int b) { return forest.less(a, b); };
  std::make_heap(trees.begin(), trees.end(), less);
  while (!trees.empty() && (total < kWorthwhile || forest.work[trees.front()] > kShare * total)) {
    std::pop_heap(trees.begin(), trees.end(), less);
    const int s = trees.back();
    trees.pop_back();
    on_top[s] = 1;
    for (const int child : forest.children[s]) {
      trees.push_back(child);
      std::push_heap(trees.begin(), trees.end(), less);
    }
  }
  std::sort(trees.begin(), trees.end(), [&](int a, int b) { return forest.less(b, a); });
  return trees;
}

// Deals subtrees out to parts that can be factorized at the same time, each to the part that has least to do so far.
void PanelFactor::planParts() {
  const Forest forest(*this);
  const std::size_t count = panels_.size();
  std::vector<char> on_top(count, 0);
  const std::vector<int> trees = splitSubtrees(forest, on_top);
  parts_.assign(std::min<std::size_t>(trees.size(), kMostParts), {});
  std::vector<double> dealt(parts_.size(), 0.0);
  std::vector<int> part_of(count, -1);
  for (const int s : trees) {
    const auto least = std::min_element(dealt.begin(), dealt.end());
    *least += forest.work[s];
    part_of[s] = static_cast<int>(least - dealt.begin());
  }
  top_.clear();
  for (std::size_t s = count; s-- > 0;) {  // parents before their children, then turned round
    if (on_top[s]) {
      top_.push_back(static_cast<int>(s));
      continue;
    }
    if (part_of[s] < 0) part_of[s] = part_of[parent(static_cast<int>(s))];
    parts_[part_of[s]].push_back(static_cast<int>(s));
  }
  for (std::vector<int>& part : parts_) std::reverse(part.begin(), part.end());
  std::reverse(top_.begin(), top_.end());
  products_.resize(top_.size() == count ? 1 : kMostParts, products_.front());
  planTop();
}

// Where the parts leave what they take off the panels on top: their columns, one panel after the other.
void PanelFactor::planTop() {
  if (!inParts()) return;
  int columns = 0;
  top_place_.assign(panel_of_.size(), -1);
  for (const int s : top_) {
    for (int j = 0; j < panels_[s].columns; ++j) top_place_[panels_[s].first + j] = columns++;
  }
  rooms_.resize(parts_.size(), rooms_.front());
  for (Room& room : rooms_) room.top.assign(3 * static_cast<std::size_t>(columns), 0.0);
}

// What earlier panels take off the columns [first_column, last_column) of a panel.
void PanelFactor::applyUpdates(double* values, int index, int first_column, int last_column,
                               std::vector<double>& columns) {
  const Panel& target = panels_[index];
  double* to = values + target.value;
  const int c_stride = static_cast<int>(columns.size()) / 3;
  for (int u = update_begin_[index]; u < update_begin_[index + 1]; ++u) {
    const Update& update = updates_[u];
    const Panel& source = panels_[update.source];
    const double* from = values + source.value;
    for (int j = update.first; j < update.last; ++j) {
      const int* map = map_.data() + update.map + (j - update.first);
      if (map[0] < first_column || map[0] >= last_column) continue;
      const int count = source.rows - j;
      product(from + 3 * j, from + 3 * j, source.stride, 3 * source.columns, 3 * count, columns.data(), c_stride);
      for (int c = 0; c < 3; ++c) {
        double* column = to + static_cast<std::size_t>(3 * map[0] + c) * target.stride;
        const double* sum = columns.data() + c * c_stride;
        for (int r = 0; r < count; ++r) {
          double* entry = column + 3 * map[r];
          entry[0] -= sum[3 * r];
          entry[1] -= sum[3 * r + 1];
          entry[2] -= sum[3 * r + 2];
        }
      }
    }
  }
}

bool PanelFactor::factorizePanel(double* values, int index, std::vector<double>& columns) {
  const Panel& panel = panels_[index];
  double* panel_values = values + panel.value;
  const int stride = panel.stride;
  const int c_stride = static_cast<int>(columns.size()) / 3;
  for (int j = 0; j < panel.columns; ++j) {
    const int rows = 3 * (panel.rows - j);
    double* c0 = panel_values + static_cast<std::size_t>(3 * j) * stride + 3 * j;
    double* c1 = c0 + stride;
    double* c2 = c1 + stride;
    if (j > 0) {
      double* sum = columns.data();
      product(panel_values + 3 * j, panel_values + 3 * j, stride, 3 * j, rows, sum, c_stride);
      for (int r = 0; r < rows; ++r) c0[r] -= sum[r];
      for (int r = 0; r < rows; ++r) c1[r] -= sum[c_stride + r];
      for (int r = 0; r < rows; ++r) c2[r] -= sum[2 * c_stride + r];
    }
    // 3x3 Cholesky of the diagonal block
    if (!isPivot(c0[0])) return false;
    const double l00 = std::sqrt(c0[0]), i0 = 1.0 / l00;
    const double l10 = c0[1] * i0, l20 = c0[2] * i0;
    const double d1 = c1[1] - l10 * l10;
    if (!isPivot(d1)) return false;
    const double l11 = std::sqrt(d1), i1 = 1.0 / l11;
    const double l21 = (c1[2] - l20 * l10) * i1;
    const double d2 = c2[2] - l20 * l20 - l21 * l21;
    if (!isPivot(d2)) return false;
    const double l22 = std::sqrt(d2), i2 = 1.0 / l22;
    c0[0] = l00, c0[1] = l10, c0[2] = l20, c1[1] = l11, c1[2] = l21, c2[2] = l22;
    c1[0] = c2[0] = c2[1] = 0.0;  // packs may reach into the upper triangle; nothing there may be infinite
    double* inverse = inverse_diagonal_.data() + 3 * (panel.first + j);
    inverse[0] = i0, inverse[1] = i1, inverse[2] = i2;
    for (int r = 3; r < rows; ++r) {
      const double x0 = c0[r] * i0;
      const double x1 = (c1[r] - x0 * l10) * i1;
      c0[r] = x0;
      c1[r] = x1;
      c2[r] = (c2[r] - x0 * l20 - x1 * l21) * i2;
    }
  }
  return true;
}

// Without parts beside it a panel's columns are shared out.
bool PanelFactor::factorizeOnTop(double* values, int index) {
  constexpr int kLeastColumns = 4;  // of a part
  const int columns = panels_[index].columns;
  const int parts = products_.size() > 1 ? std::clamp(columns / kLeastColumns, 1, kMostParts) : 1;
  parallelRanges(parts, columns,
                 [&](int begin, int end, int part) { applyUpdates(values, index, begin, end, products_[part]); });
  return factorizePanel(values, index, products_.front());
}

bool PanelFactor::factorize(double* values) {
  std::atomic<bool> good{true};
  parallelFor(static_cast<int>(parts_.size()), [&](int part) {
    for (const int s : parts_[part]) {
      applyUpdates(values, s, 0, panels_[s].columns, products_[part]);
      if (!factorizePanel(values, s, products_[part])) {
        good.store(false, std::memory_order_relaxed);
        return;
      }
    }
  });
  if (!good.load(std::memory_order_relaxed)) return false;
  return std::all_of(top_.begin(), top_.end(), [&](int s) { return factorizeOnTop(values, s); });
}

bool PanelFactor::invertDiagonal(const double* values) {
  for (const Panel& panel : panels_) {
    for (int c = 0; c < 3 * panel.columns; ++c) {
      const double d = values[panel.value + static_cast<std::size_t>(c) * panel.stride + c];
      if (!isPivot(d)) return false;
      inverse_diagonal_[3 * panel.first + c] = 1.0 / d;
    }
  }
  return true;
}

namespace {

/// Three rows of W right-hand sides each.
template <int W>
struct Rows3 {
  static constexpr int kWidth = std::min(W, kLanes);  // of one register
  static constexpr int kRegisters = W / kWidth;
  typedef double T __attribute__((vector_size(kWidth * sizeof(double))));
  T v[3][kRegisters];

  void load(const double* from) {
    for (int i = 0; i < 3; ++i)
      for (int p = 0; p < kRegisters; ++p) std::memcpy(&v[i][p], from + i * W + p * kWidth, sizeof(T));
  }
  void store(double* to) const {
    for (int i = 0; i < 3; ++i)
      for (int p = 0; p < kRegisters; ++p) std::memcpy(to + i * W + p * kWidth, &v[i][p], sizeof(T));
  }
  /// v_i -= a[i * step] x for one row x of right-hand sides.
  void subtract(const double* a, std::size_t step, const double* x) {
    for (int p = 0; p < kRegisters; ++p) {
      T row;
      std::memcpy(&row, x + p * kWidth, sizeof(T));
      for (int i = 0; i < 3; ++i) v[i][p] -= a[static_cast<std::size_t>(i) * step] * row;
    }
  }
  void eliminate(int i, double a, int j) {
    for (int p = 0; p < kRegisters; ++p) v[i][p] -= a * v[j][p];
  }
  void scale(int i, double a) {
    for (int p = 0; p < kRegisters; ++p) v[i][p] *= a;
  }
};

}  // namespace

template <int W>
void PanelFactor::forward(const double* values, double* x, int begin, std::span<const char> active) const {
  for (std::size_t s = static_cast<std::size_t>(begin); s < panels_.size(); ++s) {
    if (!active.empty() && !active[s]) continue;
    const Panel& panel = panels_[s];
    const double* l = values + panel.value;
    const std::size_t stride = static_cast<std::size_t>(panel.stride);
    const double* inverse = inverse_diagonal_.data() + 3 * panel.first;
    double* own = x + static_cast<std::size_t>(3 * panel.first) * W;
    const int* rows = rows_.data() + panel.row_begin;
    // block row by block row: each takes the part of the panel's own x that is complete by then
    for (int r = 0; r < panel.rows; ++r) {
      const bool diagonal = r < panel.columns;
      const int depth = diagonal ? 3 * r : 3 * panel.columns;
      double* target = x + static_cast<std::size_t>(3 * rows[r]) * W;
      Rows3<W> sum;
      sum.load(target);
      const double* a = l + 3 * r;
      for (int k = 0; k < depth; ++k, a += stride) sum.subtract(a, 1, own + static_cast<std::size_t>(k) * W);
      if (diagonal) {
        sum.scale(0, inverse[3 * r]);
        sum.eliminate(1, a[1], 0);
        sum.scale(1, inverse[3 * r + 1]);
        sum.eliminate(2, a[2], 0);
        sum.eliminate(2, a[stride + 2], 1);
        sum.scale(2, inverse[3 * r + 2]);
      }
      sum.store(target);
    }
  }
}

template <int W>
void PanelFactor::backward(const double* values, double* x, std::span<const char> active) const {
  for (std::size_t s = panels_.size(); s-- > 0;) {
    if (!active.empty() && !active[s]) continue;
    const Panel& panel = panels_[s];
    const std::size_t stride = static_cast<std::size_t>(panel.stride);
    const double* inverse = inverse_diagonal_.data() + 3 * panel.first;
    const int* rows = rows_.data() + panel.row_begin;
    for (int j = panel.columns - 1; j >= 0; --j) {
      const double* a = values + panel.value + 3 * static_cast<std::size_t>(j) * stride;
      double* target = x + static_cast<std::size_t>(3 * (panel.first + j)) * W;
      Rows3<W> sum;
      sum.load(target);
      for (int r = j + 1; r < panel.rows; ++r) {
        const double* below = x + static_cast<std::size_t>(3 * rows[r]) * W;
        for (int i = 0; i < 3; ++i) sum.subtract(a + 3 * r + i, stride, below + i * W);
      }
      const double* d = a + 3 * j;
      sum.scale(2, inverse[3 * j + 2]);
      sum.eliminate(1, d[stride + 2], 2);
      sum.scale(1, inverse[3 * j + 1]);
      sum.eliminate(0, d[1], 1);
      sum.eliminate(0, d[2], 2);
      sum.scale(0, inverse[3 * j]);
      sum.store(target);
    }
  }
}

namespace {

constexpr int kShared = 40'000;  // entries of a part of a panel's product; some 20 us
constexpr int kMostShares = 8;

int sharesOf(int width, int below) { return std::clamp(width * below / kShared, 1, kMostShares); }

// Calls f(begin, end) for ranges of the rows below a panel; each begins with a pair of packs.
template <class F>
void shareRows(int width, int below, F&& f) {
  constexpr int kPair = 2 * kLanes;
  parallelRanges(sharesOf(width, below), (below + kPair - 1) / kPair,
                 [&](int begin, int end) { f(kPair * begin, std::min(kPair * end, below)); });
}

// The same for its columns, node by node.
template <class F>
void shareColumns(int width, int below, F&& f) {
  parallelRanges(sharesOf(width, below), width / 3, [&](int begin, int end) { f(3 * begin, 3 * end); });
}

}  // namespace

// One right-hand side: the same along the columns of the panels, which are contiguous. What a panel's rows below take
// or give is a product of its own, so that large panels on top can be shared out.

// What a panel's own rows take off the rows [begin, end) below; begin is a multiple of two packs.
void PanelFactor::forwardBelow(const double* values, int index, const double* x, int begin, int end,
                               double* sum) const {
  const Panel& panel = panels_[index];
  const int width = 3 * panel.columns;
  const double* own = x + 3 * panel.first;
  const double* block = values + panel.value + width + begin;
  for (int r = begin; r < end; r += 2 * kLanes, block += 2 * kLanes) {
    Pack s0 = {}, s1 = {};
    const double* a = block;
    for (int k = 0; k < width; ++k, a += panel.stride) {
      Pack a0, a1;
      load(a0, a);
      load(a1, a + kLanes);
      s0 += a0 * own[k];
      s1 += a1 * own[k];
    }
    store(sum + r, s0);
    store(sum + r + kLanes, s1);
  }
}

// What the panel takes off panels on top goes to `top`, or to x where that is null.
void PanelFactor::forwardOf(const double* values, int index, Room& room, double* x, double* top) const {
  const Panel& panel = panels_[index];
  const int width = 3 * panel.columns, below = 3 * (panel.rows - panel.columns);
  double* own = x + 3 * panel.first;
  const double* column = values + panel.value;
  for (int k = 0; k < width; ++k, column += panel.stride) {
    own[k] *= inverse_diagonal_[3 * panel.first + k];
    for (int r = k + 1; r < width; ++r) own[r] -= column[r] * own[k];
  }
  double* sum = room.below.data();
  shareRows(width, below, [&](int begin, int end) { forwardBelow(values, index, x, begin, end, sum); });
  const int* rows = rows_.data() + panel.row_begin + panel.columns;
  for (int r = 0; r < below / 3; ++r) {
    const int place = top != nullptr ? top_place_[rows[r]] : -1;
    double* to = place < 0 ? x + 3 * rows[r] : top + 3 * place;
    for (int i = 0; i < 3; ++i) to[i] -= sum[3 * r + i];
  }
}

template <>
void PanelFactor::forward<1>(const double* values, double* x, int begin, std::span<const char> active) const {
  if (begin > 0 || !active.empty() || !inParts()) {
    for (int s = begin; s < static_cast<int>(panels_.size()); ++s) {
      if (active.empty() || active[s]) forwardOf(values, s, rooms_.front(), x, nullptr);
    }
    return;
  }
  parallelFor(static_cast<int>(parts_.size()), [&](int part) {
    Room& room = rooms_[part];
    std::fill(room.top.begin(), room.top.end(), 0.0);
    for (const int s : parts_[part]) forwardOf(values, s, room, x, room.top.data());
  });
  for (const Room& room : rooms_) {
    const double* from = room.top.data();
    for (const int s : top_) {
      double* to = x + 3 * panels_[s].first;
      for (int k = 0; k < 3 * panels_[s].columns; ++k) to[k] += *from++;
    }
  }
  for (const int s : top_) forwardOf(values, s, rooms_.front(), x, nullptr);
}

// Products of the columns [begin, end), multiples of 3, with the rows below.
void PanelFactor::backwardBelow(const double* values, int index, const double* below_x, int begin, int end,
                                double* dots) const {
  const Panel& panel = panels_[index];
  const int width = 3 * panel.columns, below = 3 * (panel.rows - panel.columns);
  for (int j = begin; j < end; j += 3) {
    const double* c0 = values + panel.value + static_cast<std::size_t>(j) * panel.stride + width;
    const double* c1 = c0 + panel.stride;
    const double* c2 = c1 + panel.stride;
    Pack p0 = {}, p1 = {}, p2 = {};
    for (int r = 0; r < below; r += kLanes) {
      Pack xr, a0, a1, a2;
      load(xr, below_x + r);
      load(a0, c0 + r);
      load(a1, c1 + r);
      load(a2, c2 + r);
      p0 += a0 * xr;
      p1 += a1 * xr;
      p2 += a2 * xr;
    }
    double s0 = 0, s1 = 0, s2 = 0;
    for (int i = 0; i < kLanes; ++i) s0 += p0[i], s1 += p1[i], s2 += p2[i];
    dots[j] = s0, dots[j + 1] = s1, dots[j + 2] = s2;
  }
}

void PanelFactor::backwardOf(const double* values, int index, Room& room, double* x) const {
  const Panel& panel = panels_[index];
  const int width = 3 * panel.columns, below = 3 * (panel.rows - panel.columns);
  const int* rows = rows_.data() + panel.row_begin + panel.columns;
  double* below_x = room.below.data();
  for (int r = 0; r < below / 3; ++r)
    for (int i = 0; i < 3; ++i) below_x[3 * r + i] = x[3 * rows[r] + i];
  std::fill(below_x + below, below_x + below + kLanes, 0.0);  // rows that the last pack has too many
  double* dots = room.dots.data();
  shareColumns(width, below, [&](int begin, int end) { backwardBelow(values, index, below_x, begin, end, dots); });
  double* own = x + 3 * panel.first;
  for (int j = width - 3; j >= 0; j -= 3) {
    const double* c0 = values + panel.value + static_cast<std::size_t>(j) * panel.stride;
    const double* c1 = c0 + panel.stride;
    const double* c2 = c1 + panel.stride;
    double s0 = dots[j], s1 = dots[j + 1], s2 = dots[j + 2];
    for (int r = j + 3; r < width; ++r) s0 += c0[r] * own[r], s1 += c1[r] * own[r], s2 += c2[r] * own[r];
    const double* inverse = inverse_diagonal_.data() + 3 * panel.first + j;
    own[j + 2] = (own[j + 2] - s2) * inverse[2];
    own[j + 1] = (own[j + 1] - s1 - c1[j + 2] * own[j + 2]) * inverse[1];
    own[j] = (own[j] - s0 - c0[j + 1] * own[j + 1] - c0[j + 2] * own[j + 2]) * inverse[0];
  }
}

template <>
void PanelFactor::backward<1>(const double* values, double* x, std::span<const char> active) const {
  if (!active.empty() || !inParts()) {
    for (int s = static_cast<int>(panels_.size()); s-- > 0;) {
      if (active.empty() || active[s]) backwardOf(values, s, rooms_.front(), x);
    }
    return;
  }
  for (std::size_t k = top_.size(); k-- > 0;) backwardOf(values, top_[k], rooms_.front(), x);
  parallelFor(static_cast<int>(parts_.size()), [&](int part) {
    const std::vector<int>& own = parts_[part];
    for (std::size_t k = own.size(); k-- > 0;) backwardOf(values, own[k], rooms_[part], x);
  });
}

template void PanelFactor::forward<4>(const double*, double*, int, std::span<const char>) const;
template void PanelFactor::forward<8>(const double*, double*, int, std::span<const char>) const;
template void PanelFactor::forward<16>(const double*, double*, int, std::span<const char>) const;
template void PanelFactor::backward<4>(const double*, double*, std::span<const char>) const;
template void PanelFactor::backward<8>(const double*, double*, std::span<const char>) const;
template void PanelFactor::backward<16>(const double*, double*, std::span<const char>) const;

}  // namespace palpate
