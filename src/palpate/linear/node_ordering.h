#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "palpate/linear/symmetric_block_matrix.h"

namespace palpate {

/// Fill-reducing order of the nodes of a pattern.
struct NodeOrdering {
  std::vector<int>
      order;  ///< order[k]: node eliminated k-th; postordered, `last` nodes at the end in their given order
  std::vector<std::pair<int, int>>
      couplings;       ///< pairs of nodes that the pattern couples, the last ones all with each other
  double flops = 0.0;  ///< operations of a 3x3 block factorization in this order
  std::string name;    ///< which method found it
};

/// Tries several orderings of the node graph and keeps the cheapest. `last`: distinct nodes of the pattern.
NodeOrdering orderNodes(const SymmetricBlockMatrix& pattern, std::span<const int> last);

/// An ordering that was found, with more nodes last: they come from where they were to the end. Takes no search, and
/// somewhat more fill.
/// @param last  those that `found` has last, in its order, then the others
NodeOrdering withMoreLast(const SymmetricBlockMatrix& pattern, const std::vector<int>& found,
                          std::span<const int> last);

}  // namespace palpate
