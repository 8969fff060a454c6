#include "palpate/linear/sparse_cholesky.h"

#include <cholmod.h>
#include <dlfcn.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <vector>

#include "palpate/common/parallel.h"
#include "palpate/linear/node_ordering.h"
#include "palpate/linear/panel_factor.h"

namespace palpate {
namespace {

// Below this many operations the own factorization is faster (docs/sparse-factorization.md).
constexpr double kCompactFlops = 2e9;

/// Keeps CHOLMOD's own parallel loops on the calling thread. Debian's build starts four threads for each, whatever the
/// machine has, which costs several times the factorization of a small matrix. Looked up at run time: a CHOLMOD built
/// without OpenMP does not have the functions and does not need them.
class SingleThread {
 public:
  SingleThread() {
    if (functions().set == nullptr || functions().get == nullptr) return;
    levels_ = functions().get();
    functions().set(0);
  }
  ~SingleThread() {
    if (levels_ >= 0) functions().set(levels_);
  }
  SingleThread(const SingleThread&) = delete;
  SingleThread& operator=(const SingleThread&) = delete;

 private:
  struct Functions {
    void (*set)(int) = nullptr;
    int (*get)() = nullptr;
  };
  static const Functions& functions() {
    static const Functions found = {reinterpret_cast<void (*)(int)>(dlsym(RTLD_DEFAULT, "omp_set_max_active_levels")),
                                    reinterpret_cast<int (*)()>(dlsym(RTLD_DEFAULT, "omp_get_max_active_levels"))};
    return found;
  }
  int levels_ = -1;
};

/// Where a 3x3 block of the matrix goes in a column-major array.
struct Destination {
  std::size_t offset;
  int stride;
  bool transposed;
};

// Parts of `count` things that are worth a thread's while.
int partsOf(std::size_t count) {
  constexpr std::size_t kLeast = 4096, kMost = 8;
  return static_cast<int>(std::clamp<std::size_t>(count / kLeast, 1, kMost));
}

void setZero(std::vector<double>& values) {
  constexpr std::size_t kLine = 8;
  parallelRanges(partsOf(values.size() / kLine), static_cast<int>(values.size()),
                 [&](int begin, int end) { std::fill(values.begin() + begin, values.begin() + end, 0.0); });
}

void scatterPart(const SymmetricBlockMatrix& matrix, const std::vector<Destination>& destinations, int begin, int end,
                 double* to) {
  const double* block = matrix.values.data() + 9 * static_cast<std::ptrdiff_t>(begin);
  for (int i = begin; i < end; ++i) {
    const Destination& d = destinations[i];
    double* c0 = to + d.offset;
    double* c1 = c0 + d.stride;
    double* c2 = c1 + d.stride;
    if (d.transposed) {
      c0[0] = block[0], c0[1] = block[3], c0[2] = block[6];
      c1[0] = block[1], c1[1] = block[4], c1[2] = block[7];
      c2[0] = block[2], c2[1] = block[5], c2[2] = block[8];
    } else {
      c0[0] = block[0], c0[1] = block[1], c0[2] = block[2];
      c1[0] = block[3], c1[1] = block[4], c1[2] = block[5];
      c2[0] = block[6], c2[1] = block[7], c2[2] = block[8];
    }
    block += 9;
  }
}

void scatter(const SymmetricBlockMatrix& matrix, const std::vector<Destination>& destinations, double* to) {
  const int count = static_cast<int>(destinations.size()), parts = partsOf(destinations.size());
  parallelRanges(parts, count, [&](int begin, int end) { scatterPart(matrix, destinations, begin, end, to); });
}

}  // namespace

struct SparseCholesky::Impl {
  static constexpr Eigen::Index kChunk = 16;           // right-hand sides that go through the factor together
  static constexpr std::size_t kLeastShared = 20'000;  // entries of a factor that is worth several threads

  Impl() {
    cholmod_start(&common);
    common.print = 0;
    common.supernodal = CHOLMOD_SUPERNODAL;
    common.nmethods = 1;
    common.method[0].ordering = CHOLMOD_NATURAL;  // the matrix is handed over in order, and stays so
    common.postorder = 0;
#if CHOLMOD_MAIN_VERSION >= 4
    common.nthreads_max = 1;
#endif
  }
  ~Impl() {
    cholmod_free_factor(&symbolic, &common);
    cholmod_finish(&common);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void seek(const SymmetricBlockMatrix& pattern, std::span<const int> last_nodes);
  void analyze(const SymmetricBlockMatrix& pattern, const NodeOrdering& ordering, std::size_t last_nodes,
               Numeric numeric);
  void buildPermutedPattern(const NodeOrdering& ordering);
  void findPanels();
  void buildDestinations(const SymmetricBlockMatrix& pattern);
  void copyTrailing();
  template <typename Solve>
  static void inChunk(Eigen::Index begin, Eigen::Index count, const Solve& solve);
  template <typename Solve>
  static void inChunks(Eigen::Index columns, const Solve& solve);
  template <int W>
  void gather(const Eigen::Ref<const MatX>& from, Eigen::Index column, Eigen::Index count, double* to) const;
  template <int W>
  void scatterBack(Eigen::Ref<MatX> to, Eigen::Index column, Eigen::Index count, bool permuted,
                   const double* from) const;
  void markActive(Eigen::Index width);
  void markWays(const BlockColumns& columns, std::vector<char>& on_way) const;
  template <int W>
  void between(const BlockColumns& left, const BlockColumns& right, Eigen::Index column, Eigen::Index count, double* x,
               MatX& out) const;
  Eigen::Index chunkFor(Eigen::Index columns) const;

  cholmod_common common;
  cholmod_factor* symbolic = nullptr;
  cholmod_sparse permuted{};  // P A P^T, lower triangle with whole 3x3 blocks on the diagonal
  std::vector<int> permuted_column, permuted_row;
  std::vector<double> permuted_values;  // of CHOLMOD's numeric factorization only

  PanelFactor panels;
  PanelGram gram;
  std::vector<double> panel_values;  // with padding
  const double* factor = nullptr;    // panel_values once they hold a factor

  // the ordering that was sought last, what for
  NodeOrdering sought;
  std::vector<int> sought_last, sought_column, sought_row;

  std::vector<int> order, position;  // node of a position in the factor, and the reverse
  std::vector<Destination> destinations;
  int last = 0;         // nodes of the trailing block
  int first_panel = 0;  // that holds part of the trailing block
  MatX trailing;
  std::vector<double> work;  // row-major right-hand sides in the order of the factor, a chunk or several
  std::vector<char> active;
  std::vector<double> between_work;  // of between(), which may run beside other solves
  std::vector<char> left_way, right_way;
  Statistics statistics;
};

void SparseCholesky::Impl::buildPermutedPattern(const NodeOrdering& ordering) {
  const int n = static_cast<int>(ordering.order.size());
  order = ordering.order;
  position.resize(n);
  for (int k = 0; k < n; ++k) position[order[k]] = k;
  std::vector<std::pair<int, int>> pairs;
  pairs.reserve(ordering.couplings.size());
  for (const auto& [i, j] : ordering.couplings) pairs.emplace_back(position[i], position[j]);
  const SymmetricBlockMatrix pattern = SymmetricBlockMatrix::fromPairs(n, pairs);

  permuted_column.assign(1, 0);
  permuted_row.clear();
  for (int j = 0; j < n; ++j) {
    for (int c = 0; c < 3; ++c) {
      for (int slot = pattern.column[j]; slot < pattern.column[j + 1]; ++slot)
        for (int r = 0; r < 3; ++r) permuted_row.push_back(3 * pattern.row[slot] + r);
      permuted_column.push_back(static_cast<int>(permuted_row.size()));
    }
  }
  permuted = cholmod_sparse{};
  permuted.nrow = permuted.ncol = 3 * static_cast<std::size_t>(n);
  permuted.nzmax = permuted_row.size();
  permuted.p = permuted_column.data();
  permuted.i = permuted_row.data();
  permuted.stype = -1;
  permuted.itype = CHOLMOD_INT;
  permuted.xtype = CHOLMOD_PATTERN;
  permuted.dtype = CHOLMOD_DOUBLE;
  permuted.sorted = permuted.packed = 1;
}

void SparseCholesky::Impl::findPanels() {
  cholmod_free_factor(&symbolic, &common);
  symbolic = cholmod_analyze(&permuted, &common);
  if (symbolic == nullptr || !symbolic->is_super) throw std::runtime_error("CHOLMOD could not analyze the matrix");

  const int* super = static_cast<const int*>(symbolic->super);
  const int* index_begin = static_cast<const int*>(symbolic->pi);
  const int* value_begin = static_cast<const int*>(symbolic->px);
  const int* index = static_cast<const int*>(symbolic->s);
  std::vector<PanelFactor::Panel> found;
  std::vector<int> rows;
  for (std::size_t s = 0; s < symbolic->nsuper; ++s) {
    const int scalar_rows = index_begin[s + 1] - index_begin[s];
    // The columns of a node have like structure, so supernodes consist of whole nodes.
    if (super[s] % 3 != 0 || super[s + 1] % 3 != 0 || scalar_rows % 3 != 0)
      throw std::logic_error("a supernode splits a node");
    PanelFactor::Panel panel;
    panel.first = super[s] / 3;
    panel.columns = (super[s + 1] - super[s]) / 3;
    panel.rows = scalar_rows / 3;
    panel.row_begin = static_cast<int>(rows.size());
    panel.value = static_cast<std::size_t>(value_begin[s]);
    panel.stride = scalar_rows;
    for (int r = 0; r < panel.rows; ++r) rows.push_back(index[index_begin[s] + 3 * r] / 3);
    found.push_back(panel);
  }
  panels.setStructure(std::move(found), std::move(rows));
  gram.setStructure(panels);
}

void SparseCholesky::Impl::buildDestinations(const SymmetricBlockMatrix& pattern) {
  const bool compact = statistics.numeric == "compact";
  destinations.clear();
  for (int j = 0; j < pattern.size; ++j) {
    for (int slot = pattern.column[j]; slot < pattern.column[j + 1]; ++slot) {
      const int i = pattern.row[slot];
      const int row = std::max(position[i], position[j]);
      const int column = std::min(position[i], position[j]);
      Destination d{};
      d.transposed = position[i] < position[j];
      if (compact) {
        const PanelFactor::Panel& panel = panels.panels()[panels.panelOf(column)];
        const auto begin = panels.rows().begin() + panel.row_begin;
        const auto at = std::lower_bound(begin, begin + panel.rows, row) - begin;
        d.stride = panel.stride;
        d.offset = panel.value + static_cast<std::size_t>(3 * (column - panel.first)) * panel.stride +
                   3 * static_cast<std::size_t>(at);
      } else {
        const auto begin = permuted_row.begin() + permuted_column[3 * column];
        const auto end = permuted_row.begin() + permuted_column[3 * column + 1];
        d.stride = permuted_column[3 * column + 1] - permuted_column[3 * column];
        d.offset = static_cast<std::size_t>(std::lower_bound(begin, end, 3 * row) - permuted_row.begin());
      }
      destinations.push_back(d);
    }
  }
}

void SparseCholesky::Impl::copyTrailing() {
  const int first_node = static_cast<int>(order.size()) - last;
  for (std::size_t s = static_cast<std::size_t>(first_panel); last > 0 && s < panels.panels().size(); ++s) {
    const PanelFactor::Panel& panel = panels.panels()[s];
    // part of the panel's columns may belong to the interior; the rows of the rest are all last nodes
    for (int j = std::max(0, first_node - panel.first); j < panel.columns; ++j) {
      for (int c = 0; c < 3; ++c) {
        const double* column = factor + panel.value + static_cast<std::size_t>(3 * j + c) * panel.stride;
        double* to = trailing.col(3 * (panel.first + j - first_node) + c).data();
        for (int r = j; r < panel.rows; ++r) {
          const int row = 3 * (panels.rows()[panel.row_begin + r] - first_node);
          for (int i = r == j ? c : 0; i < 3; ++i) to[row + i] = column[3 * r + i];
        }
      }
    }
  }
}

// Calls solve(width, first column, columns): the narrowest that there is for so many.
template <typename Solve>
void SparseCholesky::Impl::inChunk(Eigen::Index begin, Eigen::Index count, const Solve& solve) {
  if (count > 8) {
    solve(std::integral_constant<int, 16>(), begin, count);
  } else if (count > 4) {
    solve(std::integral_constant<int, 8>(), begin, count);
  } else if (count > 1) {
    solve(std::integral_constant<int, 4>(), begin, count);
  } else {
    solve(std::integral_constant<int, 1>(), begin, count);
  }
}

template <typename Solve>
void SparseCholesky::Impl::inChunks(Eigen::Index columns, const Solve& solve) {
  for (Eigen::Index begin = 0; begin < columns; begin += kChunk) {
    inChunk(begin, std::min(columns - begin, kChunk), solve);
  }
}

template <int W>
void SparseCholesky::Impl::gather(const Eigen::Ref<const MatX>& from, Eigen::Index column, Eigen::Index count,
                                  double* to) const {
  if (count < W) std::fill(to, to + 3 * order.size() * W, 0.0);
  for (Eigen::Index c = 0; c < count; ++c) {
    const double* source = from.col(column + c).data();
    for (std::size_t k = 0; k < order.size(); ++k)
      for (int i = 0; i < 3; ++i) to[(3 * k + i) * W + c] = source[3 * order[k] + i];
  }
}

template <int W>
void SparseCholesky::Impl::scatterBack(Eigen::Ref<MatX> to, Eigen::Index column, Eigen::Index count, bool keep_order,
                                       const double* from) const {
  for (Eigen::Index c = 0; c < count; ++c) {
    double* target = to.col(column + c).data();
    for (std::size_t k = 0; k < order.size(); ++k)
      for (int i = 0; i < 3; ++i)
        target[3 * (keep_order ? static_cast<int>(k) : order[k]) + i] = from[(3 * k + i) * W + c];
  }
}

/// Panels in which the right-hand sides in `work` have entries, and those that these lead to.
void SparseCholesky::Impl::markActive(Eigen::Index width) {
  const auto& all = panels.panels();
  std::fill(active.begin(), active.end(), 0);
  for (std::size_t s = 0; s < all.size(); ++s) {
    const double* begin = work.data() + 3 * all[s].first * width;
    const double* end = begin + 3 * all[s].columns * width;
    if (!active[s] && std::any_of(begin, end, [](double v) { return v != 0.0; })) active[s] = 1;
    const int parent = panels.parent(static_cast<int>(s));
    if (active[s] && parent >= 0) active[parent] = 1;
  }
}

SparseCholesky::SparseCholesky() : impl_(std::make_unique<Impl>()) {}
SparseCholesky::~SparseCholesky() = default;
SparseCholesky::SparseCholesky(SparseCholesky&&) noexcept = default;
SparseCholesky& SparseCholesky::operator=(SparseCholesky&&) noexcept = default;

void SparseCholesky::analyze(const SymmetricBlockMatrix& pattern, std::span<const int> last_nodes, Numeric numeric) {
  extend(pattern, last_nodes, last_nodes.size(), numeric);
}

void SparseCholesky::extend(const SymmetricBlockMatrix& pattern, std::span<const int> last_nodes, std::size_t sought,
                            Numeric numeric) {
  if (sought > last_nodes.size()) throw std::invalid_argument("SparseCholesky: fewer last nodes than were sought for");
  std::vector<char> seen(pattern.size, 0);
  for (const int node : last_nodes) {
    if (node < 0 || node >= pattern.size || seen[node])
      throw std::invalid_argument("SparseCholesky: last nodes must be distinct nodes of the matrix");
    seen[node] = 1;
  }
  Impl& m = *impl_;
  m.seek(pattern, last_nodes.first(sought));
  if (sought == last_nodes.size()) {
    m.analyze(pattern, m.sought, sought, numeric);
  } else {
    m.analyze(pattern, withMoreLast(pattern, m.sought.order, last_nodes), last_nodes.size(), numeric);
  }
}

// Into sought, where it is not there from before.
void SparseCholesky::Impl::seek(const SymmetricBlockMatrix& pattern, std::span<const int> last_nodes) {
  if (!sought.name.empty() &&
      std::equal(last_nodes.begin(), last_nodes.end(), sought_last.begin(), sought_last.end()) &&
      sought_column == pattern.column && sought_row == pattern.row)
    return;
  sought = orderNodes(pattern, last_nodes);
  sought_last.assign(last_nodes.begin(), last_nodes.end());
  sought_column = pattern.column;
  sought_row = pattern.row;
}

void SparseCholesky::Impl::analyze(const SymmetricBlockMatrix& pattern, const NodeOrdering& ordering,
                                   std::size_t last_nodes, Numeric numeric) {
  const bool compact = numeric == Numeric::compact || (numeric == Numeric::automatic && ordering.flops < kCompactFlops);
  buildPermutedPattern(ordering);
  findPanels();

  last = static_cast<int>(last_nodes);
  statistics = {3 * pattern.size,    3 * last,
                panels.valueCount(), ordering.flops,
                sought.flops,        static_cast<int>(panels.panels().size()),
                ordering.name,       compact ? "compact" : "cholmod"};
  first_panel = last > 0 ? panels.panelOf(pattern.size - last) : 0;
  trailing = MatX::Zero(3 * last, 3 * last);
  active.assign(panels.panels().size(), 0);
  work.assign(static_cast<std::size_t>(3 * pattern.size) * 16, 0.0);
  factor = nullptr;
  if (compact) panels.planUpdates();
  buildDestinations(pattern);
  panel_values.assign(panels.valueCount() + PanelFactor::kPadding, 0.0);
  permuted_values.assign(compact ? 0 : permuted_row.size(), 0.0);
  permuted.x = permuted_values.data();
  permuted.xtype = compact ? CHOLMOD_PATTERN : CHOLMOD_REAL;
}

bool SparseCholesky::factorize(const SymmetricBlockMatrix& values) {
  Impl& m = *impl_;
  if (values.row.size() != m.destinations.size() || values.size != static_cast<int>(m.order.size()))
    throw std::invalid_argument("SparseCholesky: the matrix does not have the analyzed pattern");
  m.factor = nullptr;
  if (m.order.empty()) return true;
  if (m.statistics.numeric == "compact") {
    setZero(m.panel_values);
    scatter(values, m.destinations, m.panel_values.data());
    if (!m.panels.factorize(m.panel_values.data())) return false;
    m.factor = m.panel_values.data();
  } else {
    const SingleThread guard;
    scatter(values, m.destinations, m.permuted_values.data());
    const bool done = cholmod_factorize(&m.permuted, m.symbolic, &m.common) != 0;
    if (!done || m.common.status != CHOLMOD_OK || m.symbolic->minor < m.symbolic->n) return false;
    // copied, because the solves need padding behind the values
    const double* factor = static_cast<const double*>(m.symbolic->x);
    std::copy(factor, factor + m.panels.valueCount(), m.panel_values.begin());
    if (!m.panels.invertDiagonal(m.panel_values.data())) return false;
    m.factor = m.panel_values.data();
  }
  m.copyTrailing();
  return true;
}

// Columns have the same bits in chunks of 4, 8 and 16, though not alone: so few that one chunk would hold them are
// shared with a second thread.
Eigen::Index SparseCholesky::Impl::chunkFor(Eigen::Index columns) const {
  constexpr Eigen::Index kNarrow = 4;
  const Executor* executor = Executor::current();
  const bool alone = executor == nullptr || executor->threads() < 2 || statistics.nonzeros < kLeastShared;
  if (alone || columns <= kNarrow || columns > kChunk) return kChunk;
  const Eigen::Index chunk = columns <= 2 * kNarrow ? kNarrow : 2 * kNarrow;
  return columns % chunk == 1 ? kChunk : chunk;
}

void SparseCholesky::solve(Eigen::Ref<MatX> rhs) {
  Impl& m = *impl_;
  const Eigen::Index chunk = m.chunkFor(rhs.cols()), chunks = (rhs.cols() + chunk - 1) / chunk;
  const std::size_t size = 3 * m.order.size() * static_cast<std::size_t>(chunk);
  const bool together = chunks > 1 && m.statistics.nonzeros >= Impl::kLeastShared;
  if (together) m.work.resize(std::max(m.work.size(), static_cast<std::size_t>(chunks) * size));
  const auto solveChunk = [&](int k) {
    double* const work = m.work.data() + (together ? static_cast<std::size_t>(k) * size : 0);
    const Eigen::Index begin = k * chunk;
    Impl::inChunk(begin, std::min(rhs.cols() - begin, chunk), [&](auto width, Eigen::Index column, auto count) {
      constexpr int W = decltype(width)::value;
      m.gather<W>(rhs, column, count, work);
      m.panels.forward<W>(m.factor, work, 0);
      m.panels.backward<W>(m.factor, work);
      m.scatterBack<W>(rhs, column, count, false, work);
    });
  };
  if (together) {
    parallelFor(static_cast<int>(chunks), solveChunk);
  } else {
    for (int k = 0; k < static_cast<int>(chunks); ++k) solveChunk(k);
  }
}

void SparseCholesky::halfSolve(Eigen::Ref<MatX> rhs) {
  Impl& m = *impl_;
  m.inChunks(rhs.cols(), [&](auto width, Eigen::Index column, Eigen::Index count) {
    constexpr int W = decltype(width)::value;
    m.gather<W>(rhs, column, count, m.work.data());
    m.markActive(W);
    m.panels.forward<W>(m.factor, m.work.data(), 0, m.active);
    m.scatterBack<W>(rhs, column, count, true, m.work.data());
  });
}

const MatX& SparseCholesky::trailing() const { return impl_->trailing; }

void SparseCholesky::solveFromTrailing(const Eigen::Ref<const MatX>& r, Eigen::Ref<MatX> x) {
  Impl& m = *impl_;
  const std::size_t interior = 3 * (m.order.size() - static_cast<std::size_t>(m.last));
  m.inChunks(r.cols(), [&](auto width, Eigen::Index column, Eigen::Index count) {
    constexpr int W = decltype(width)::value;
    std::fill(m.work.begin(), m.work.begin() + static_cast<std::ptrdiff_t>(3 * m.order.size() * W), 0.0);
    for (Eigen::Index c = 0; c < count; ++c)
      for (Eigen::Index i = 0; i < r.rows(); ++i) m.work[(interior + i) * W + c] = r(i, column + c);
    m.panels.forward<W>(m.factor, m.work.data(), m.first_panel);
    m.panels.backward<W>(m.factor, m.work.data());
    m.scatterBack<W>(x, column, count, false, m.work.data());
  });
}

void SparseCholesky::gram(const BlockColumns& columns, MatX& out) {
  Impl& m = *impl_;
  out.resize(3 * columns.size(), 3 * columns.size());
  m.gram.compute(m.panels, m.factor, m.position, columns, out);
}

// Panels on the ways from the columns' nodes to the root.
void SparseCholesky::Impl::markWays(const BlockColumns& columns, std::vector<char>& on_way) const {
  on_way.assign(panels.panels().size(), 0);
  for (const int node : columns.node) {
    for (int s = panels.panelOf(position[node]); s >= 0 && !on_way[s]; s = panels.parent(s)) on_way[s] = 1;
  }
}

// Some of the right columns, in W wide room.
template <int W>
void SparseCholesky::Impl::between(const BlockColumns& left, const BlockColumns& right, Eigen::Index column,
                                   Eigen::Index count, double* x, MatX& out) const {
  for (std::size_t s = 0; s < left_way.size(); ++s) {
    if (!left_way[s] && !right_way[s]) continue;
    const PanelFactor::Panel& panel = panels.panels()[s];
    std::fill_n(x + static_cast<std::size_t>(3 * panel.first) * W, static_cast<std::size_t>(3 * panel.columns) * W,
                0.0);
  }
  const auto rowOf = [&](int node) { return x + static_cast<std::size_t>(3 * position[node]) * W; };
  for (Eigen::Index c = 0; c < count; ++c) {
    const Eigen::Index triple = (column + c) / 3, own = (column + c) % 3;
    for (int k = right.begin[triple]; k < right.begin[triple + 1]; ++k) {
      double* to = rowOf(right.node[k]) + c;
      for (int i = 0; i < 3; ++i) to[i * W] += right.block[k](i, own);
    }
  }
  panels.forward<W>(factor, x, 0, right_way);
  panels.backward<W>(factor, x, left_way);
  using Rows = Eigen::Map<const Eigen::Matrix<double, 3, W, Eigen::RowMajor>>;
  for (int l = 0; l < left.size(); ++l) {
    Eigen::Matrix<double, 3, W> sum = Eigen::Matrix<double, 3, W>::Zero();
    for (int k = left.begin[l]; k < left.begin[l + 1]; ++k) {
      sum.noalias() += left.block[k].transpose() * Rows(rowOf(left.node[k]));
    }
    out.block(3 * l, column, 3, count) = sum.leftCols(count);
  }
}

void SparseCholesky::between(const BlockColumns& left, const BlockColumns& right, MatX& out) {
  Impl& m = *impl_;
  out.resize(3 * left.size(), 3 * right.size());
  if (out.size() == 0) return;
  m.markWays(left, m.left_way);
  m.markWays(right, m.right_way);
  const Eigen::Index columns = out.cols(), chunks = (columns + Impl::kChunk - 1) / Impl::kChunk;
  const std::size_t size = 3 * m.order.size() * static_cast<std::size_t>(Impl::kChunk);
  m.between_work.resize(std::max(m.between_work.size(), static_cast<std::size_t>(chunks) * size));
  parallelFor(static_cast<int>(chunks), [&](int k) {
    double* const x = m.between_work.data() + static_cast<std::size_t>(k) * size;
    const Eigen::Index begin = k * Impl::kChunk, count = std::min(columns - begin, Impl::kChunk);
    // not those of width one: they have room for one thread
    if (count > 8) {
      m.between<16>(left, right, begin, count, x, out);
    } else if (count > 4) {
      m.between<8>(left, right, begin, count, x, out);
    } else {
      m.between<4>(left, right, begin, count, x, out);
    }
  });
}

double SparseCholesky::gramOperations(std::span<const int> nodes) {
  std::vector<int> positions;
  positions.reserve(nodes.size());
  for (const int n : nodes) positions.push_back(impl_->position[n]);
  return impl_->gram.operations(impl_->panels, positions);
}

const SparseCholesky::Statistics& SparseCholesky::statistics() const { return impl_->statistics; }

}  // namespace palpate
