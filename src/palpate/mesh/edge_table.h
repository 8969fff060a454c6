#pragma once

#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// One triangle's use of an undirected edge.
struct EdgeUse {
  int low = 0;           ///< smaller vertex index
  int high = 0;          ///< larger vertex index
  int triangle = 0;      ///< index of the triangle
  bool forward = false;  ///< the triangle runs from low to high
};

/// All edge uses, sorted by (low, high, triangle), so that the uses of one edge are neighbors.
std::vector<EdgeUse> edgeTable(const Surface& surface);

/// Calls visit(first, last) for the uses of each edge.
template <class Visit>
void forEachEdge(const std::vector<EdgeUse>& uses, Visit visit) {
  for (size_t i = 0; i < uses.size();) {
    size_t j = i + 1;
    while (j < uses.size() && uses[j].low == uses[i].low && uses[j].high == uses[i].high) ++j;
    visit(uses.data() + i, uses.data() + j);
    i = j;
  }
}

/// Disjoint sets 0 .. n-1 with path halving; the root of a set is its smallest member, so results do not depend on
/// order.
class DisjointSets {
 public:
  explicit DisjointSets(int n) : parent_(static_cast<size_t>(n)) {
    for (int i = 0; i < n; ++i) parent_[static_cast<size_t>(i)] = i;
  }
  int find(int i) {
    while (parent_[static_cast<size_t>(i)] != i) {
      int& p = parent_[static_cast<size_t>(i)];
      p = parent_[static_cast<size_t>(p)];
      i = p;
    }
    return i;
  }
  void unite(int a, int b) {
    a = find(a);
    b = find(b);
    if (a < b) parent_[static_cast<size_t>(b)] = a;
    if (b < a) parent_[static_cast<size_t>(a)] = b;
  }

 private:
  std::vector<int> parent_;
};

}  // namespace palpate
