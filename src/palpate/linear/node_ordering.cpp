#include "palpate/linear/node_ordering.h"

#include <cholmod.h>

#include <algorithm>
#include <atomic>
#include <numeric>

#include "palpate/common/one_at_a_time.h"

namespace palpate {
namespace {

using Pairs = std::vector<std::pair<int, int>>;

/// Both triangles, by columns, without the diagonal.
struct Graph {
  std::vector<int> begin;
  std::vector<int> neighbor;

  Graph(int size, const Pairs& pairs) : begin(static_cast<std::size_t>(size) + 1, 0), neighbor(2 * pairs.size()) {
    for (const auto& [i, j] : pairs) ++begin[i + 1], ++begin[j + 1];
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::vector<int> next(begin.begin(), begin.end() - 1);
    for (const auto& [i, j] : pairs) {
      neighbor[next[i]++] = j;
      neighbor[next[j]++] = i;
    }
    for (int i = 0; i < size; ++i) std::sort(neighbor.begin() + begin[i], neighbor.begin() + begin[i + 1]);
  }
  int size() const { return static_cast<int>(begin.size()) - 1; }
};

struct EliminationTree {
  std::vector<int> parent;  // -1: root
  std::vector<int> count;   // blocks in each column of L, without the diagonal one
  double flops = 0.0;
};

/// Tree and column counts by walking every row of L up the tree; nodes are named by their position in `order`.
EliminationTree eliminate(const Graph& graph, const std::vector<int>& order) {
  const int n = graph.size();
  std::vector<int> position(n);
  for (int k = 0; k < n; ++k) position[order[k]] = k;
  EliminationTree tree{std::vector<int>(n, -1), std::vector<int>(n, 0)};
  std::vector<int> visited(n, -1);
  for (int i = 0; i < n; ++i) {
    visited[i] = i;
    const int node = order[i];
    for (int e = graph.begin[node]; e < graph.begin[node + 1]; ++e) {
      int j = position[graph.neighbor[e]];
      if (j > i) continue;
      for (; visited[j] != i; j = tree.parent[j]) {
        visited[j] = i;
        ++tree.count[j];
        if (tree.parent[j] < 0) tree.parent[j] = i;
      }
    }
  }
  for (int j = 0; j < n; ++j) {  // squares of the column lengths, the usual measure
    for (int c = 1; c <= 3; ++c) tree.flops += (3.0 * tree.count[j] + c) * (3.0 * tree.count[j] + c);
  }
  return tree;
}

/// Same elimination, but children right before their parents, so that supernodes are contiguous. The last `fixed`
/// positions stay.
std::vector<int> postorder(const std::vector<int>& order, const EliminationTree& tree, int fixed) {
  const int n = static_cast<int>(order.size());
  const int free = n - fixed;
  std::vector<std::vector<int>> children(static_cast<std::size_t>(free) + 1);  // the last entry: roots of the free part
  for (int j = 0; j < free; ++j) {
    const int p = tree.parent[j];
    children[p < 0 || p >= free ? free : p].push_back(j);
  }
  // the child with the longest column next to its parent, where it may merge with it
  for (auto& list : children) {
    std::sort(list.begin(), list.end(),
              [&](int a, int b) { return tree.count[a] != tree.count[b] ? tree.count[a] < tree.count[b] : a < b; });
  }
  std::vector<int> result;
  result.reserve(n);
  std::vector<int> stack(children[free].rbegin(), children[free].rend());
  std::vector<char> expanded(free, 0);
  while (!stack.empty()) {
    const int j = stack.back();
    if (expanded[j]) {
      stack.pop_back();
      result.push_back(order[j]);
    } else {
      expanded[j] = 1;
      stack.insert(stack.end(), children[j].rbegin(), children[j].rend());
    }
  }
  result.insert(result.end(), order.begin() + free, order.end());
  return result;
}

// METIS draws from the program's one rand(), which it seeds: calls at the same time would take each other's numbers,
// and what they find, and so the rounding of every solution, would depend on chance.
std::atomic_flag metis_is_busy;

/// CHOLMOD's orderings of a graph; each returns an empty vector if the library cannot provide it.
class Orderings {
 public:
  explicit Orderings(Graph& graph) {
    cholmod_start(&common_);
    common_.print = 0;
    matrix_.nrow = matrix_.ncol = graph.begin.size() - 1;
    matrix_.nzmax = graph.neighbor.size();
    matrix_.p = graph.begin.data();
    matrix_.i = graph.neighbor.data();
    matrix_.stype = 1;  // symmetric: the upper triangle counts, the lower one is ignored
    matrix_.itype = CHOLMOD_INT;
    matrix_.xtype = CHOLMOD_PATTERN;
    matrix_.dtype = CHOLMOD_DOUBLE;
    matrix_.sorted = matrix_.packed = 1;
  }
  ~Orderings() { cholmod_finish(&common_); }
  Orderings(const Orderings&) = delete;
  Orderings& operator=(const Orderings&) = delete;

  std::vector<int> constrained(std::vector<int> set) {
    return run([&](int* order) { return cholmod_camd(&matrix_, nullptr, 0, set.data(), order, &common_) != 0; });
  }
  std::vector<int> metis() {
    const OneAtATime alone(metis_is_busy);
    return run([&](int* order) { return cholmod_metis(&matrix_, nullptr, 0, 1, order, &common_) != 0; });
  }
  std::vector<int> nestedDissection() {
    std::vector<int> parent(matrix_.nrow), member(matrix_.nrow);
    const OneAtATime alone(metis_is_busy);
    return run([&](int* order) {
      return cholmod_nested_dissection(&matrix_, nullptr, 0, order, parent.data(), member.data(), &common_) >= 0;
    });
  }

 private:
  template <typename Method>
  std::vector<int> run(const Method& method) {
    std::vector<int> order(matrix_.nrow);
    if (order.empty()) return order;
    common_.status = CHOLMOD_OK;
    return method(order.data()) && common_.status >= CHOLMOD_OK ? order : std::vector<int>();
  }

  cholmod_common common_;
  cholmod_sparse matrix_{};
};

/// Places of nodes among the last ones, -1: interior.
std::vector<int> rankAmong(std::span<const int> last, int nodes) {
  std::vector<int> rank(nodes, -1);
  for (std::size_t k = 0; k < last.size(); ++k) rank[last[k]] = static_cast<int>(k);
  return rank;
}

/// What the factor couples before elimination: pairs of the pattern, and all pairs of last nodes. Their Schur
/// complement is dense for one connected body; saying so from the start keeps it in one piece.
Pairs couplingsOf(const SymmetricBlockMatrix& pattern, std::span<const int> last, const std::vector<int>& rank) {
  Pairs couplings;
  for (int j = 0; j < pattern.size; ++j) {
    for (int slot = pattern.column[j] + 1; slot < pattern.column[j + 1]; ++slot) {
      const int i = pattern.row[slot];
      if (rank[i] < 0 || rank[j] < 0) couplings.emplace_back(i, j);
    }
  }
  for (std::size_t a = 0; a < last.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) couplings.emplace_back(last[a], last[b]);
  return couplings;
}

/// The nodes that are not last.
std::vector<int> interiorOf(const std::vector<int>& rank) {
  std::vector<int> nodes;
  for (std::size_t i = 0; i < rank.size(); ++i)
    if (rank[i] < 0) nodes.push_back(static_cast<int>(i));
  return nodes;
}

/// Of places in `nodes`, which are some of `all`.
Graph graphAmong(const std::vector<int>& nodes, const Pairs& couplings, std::size_t all) {
  std::vector<int> local(all, -1);
  for (std::size_t k = 0; k < nodes.size(); ++k) local[nodes[k]] = static_cast<int>(k);
  Pairs pairs;
  for (const auto& [i, j] : couplings)
    if (local[i] >= 0 && local[j] >= 0) pairs.emplace_back(local[i], local[j]);
  return Graph(static_cast<int>(nodes.size()), pairs);
}

/// Keeps in `best` the ordering that takes the fewest operations; of equals the first.
class Cheapest {
 public:
  Cheapest(const Graph& graph, std::span<const int> last, NodeOrdering& best)
      : graph_(graph), last_(last), best_(best) {}

  void consider(const std::vector<int>& order, const char* name) {
    if (static_cast<int>(order.size()) != graph_.size()) return;
    const EliminationTree tree = eliminate(graph_, order);
    if (!best_.name.empty() && tree.flops >= best_.flops) return;
    best_.order = postorder(order, tree, static_cast<int>(last_.size()));
    best_.flops = tree.flops;
    best_.name = name;
  }
  /// Of the interior, the last nodes after it.
  void considerInner(const std::vector<int>& inner, std::vector<int> order, const char* name) {
    for (int& k : order) k = inner[k];
    order.insert(order.end(), last_.begin(), last_.end());
    consider(order, name);
  }

 private:
  const Graph& graph_;
  std::span<const int> last_;
  NodeOrdering& best_;
};

// Nodes from which another method may find a better order than CAMD; looking for it costs as much as a few
// factorizations (docs/sparse-factorization.md).
constexpr int kDissected = 200, kLarge = 400;

}  // namespace

NodeOrdering orderNodes(const SymmetricBlockMatrix& pattern, std::span<const int> last) {
  const std::vector<int> rank = rankAmong(last, pattern.size);
  NodeOrdering best;
  best.couplings = couplingsOf(pattern, last, rank);
  Graph whole(pattern.size, best.couplings);
  const std::vector<int> interior = interiorOf(rank);
  Cheapest cheapest(whole, last, best);
  if (!interior.empty()) {
    std::vector<int> set(rank.size());
    for (std::size_t i = 0; i < rank.size(); ++i) set[i] = rank[i] + 1;
    cheapest.consider(Orderings(whole).constrained(std::move(set)), "camd");
  }
  if (!interior.empty() && pattern.size >= kDissected) {
    Graph inner = graphAmong(interior, best.couplings, rank.size());
    Orderings orderings(inner);
    cheapest.considerInner(interior, orderings.nestedDissection(), "nested-dissection");
    if (pattern.size >= kLarge) cheapest.considerInner(interior, orderings.metis(), "metis");
  }
  if (best.name.empty()) {
    std::vector<int> natural = interior;
    natural.insert(natural.end(), last.begin(), last.end());
    cheapest.consider(natural, "natural");
  }
  return best;
}

NodeOrdering withMoreLast(const SymmetricBlockMatrix& pattern, const std::vector<int>& found,
                          std::span<const int> last) {
  const std::vector<int> rank = rankAmong(last, pattern.size);
  NodeOrdering out;
  out.couplings = couplingsOf(pattern, last, rank);
  const Graph whole(pattern.size, out.couplings);
  std::vector<int> order;
  order.reserve(found.size());
  for (const int node : found) {
    if (rank[node] < 0) order.push_back(node);
  }
  order.insert(order.end(), last.begin(), last.end());
  Cheapest(whole, last, out).consider(order, "extended");
  return out;
}

}  // namespace palpate
