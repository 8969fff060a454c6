#include "palpate/linear/node_ordering.h"

#include <cholmod.h>

#include <algorithm>
#include <numeric>

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
  std::vector<int> minimumDegree() {
    return run([&](int* order) { return cholmod_amd(&matrix_, nullptr, 0, order, &common_) != 0; });
  }
  std::vector<int> metis() {
    return run([&](int* order) { return cholmod_metis(&matrix_, nullptr, 0, 1, order, &common_) != 0; });
  }
  std::vector<int> nestedDissection() {
    std::vector<int> parent(matrix_.nrow), member(matrix_.nrow);
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

}  // namespace

NodeOrdering orderNodes(const SymmetricBlockMatrix& pattern, std::span<const int> last) {
  const int n = pattern.size;
  const int fixed = static_cast<int>(last.size());
  std::vector<int> rank(n, -1);  // among the last nodes
  for (int k = 0; k < fixed; ++k) rank[last[k]] = k;

  NodeOrdering best;
  for (int j = 0; j < n; ++j) {
    for (int slot = pattern.column[j] + 1; slot < pattern.column[j + 1]; ++slot) {
      const int i = pattern.row[slot];
      if (rank[i] < 0 || rank[j] < 0) best.couplings.emplace_back(i, j);
    }
  }
  // The Schur complement is dense for one connected body; saying so from the start keeps it in one piece.
  for (int a = 0; a < fixed; ++a)
    for (int b = 0; b < a; ++b) best.couplings.emplace_back(last[a], last[b]);
  Graph whole(n, best.couplings);

  std::vector<int> interior;
  std::vector<int> local(n, -1);
  for (int i = 0; i < n; ++i) {
    if (rank[i] >= 0) continue;
    local[i] = static_cast<int>(interior.size());
    interior.push_back(i);
  }
  Pairs inner_pairs;
  for (const auto& [i, j] : best.couplings)
    if (local[i] >= 0 && local[j] >= 0) inner_pairs.emplace_back(local[i], local[j]);
  Graph inner(static_cast<int>(interior.size()), inner_pairs);

  const auto consider = [&](std::vector<int> order, const char* name) {
    if (static_cast<int>(order.size()) != n) return;
    const EliminationTree tree = eliminate(whole, order);
    if (!best.name.empty() && tree.flops >= best.flops) return;
    best.order = postorder(order, tree, fixed);
    best.flops = tree.flops;
    best.name = name;
  };
  const auto considerInner = [&](std::vector<int> order, const char* name) {
    for (int& k : order) k = interior[k];
    order.insert(order.end(), last.begin(), last.end());
    consider(std::move(order), name);
  };

  if (!interior.empty()) {
    std::vector<int> set(n);
    for (int i = 0; i < n; ++i) set[i] = rank[i] + 1;
    if (fixed < n) consider(Orderings(whole).constrained(std::move(set)), "camd");
    Orderings orderings(inner);
    considerInner(orderings.minimumDegree(), "amd");
    considerInner(orderings.metis(), "metis");
    considerInner(orderings.nestedDissection(), "nested-dissection");
  }
  if (best.name.empty()) {
    interior.insert(interior.end(), last.begin(), last.end());
    consider(std::move(interior), "natural");
  }
  return best;
}

}  // namespace palpate
