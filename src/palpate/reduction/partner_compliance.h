#pragma once

#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// A weighted sum of nodes' motions of one body, world frame; three rows.
struct NodeSum {
  int row = 0;  ///< first of its rows in the result
  std::vector<std::pair<int, double>> nodes;
};

/// How much another body gives way at the given places over a visual step, W = h' J A^-1 J^T with the factor of its
/// last step [m/N]. What else it rests on holds it: its loaded contacts with others than the tool are tied. Bodies that
/// are glued to it yield with it.
/// @param out  is added to, [3 m x 3 m], world frame
void addPartnerCompliance(World& world, int body, const std::vector<NodeSum>& sums, MatX& out);

}  // namespace palpate
