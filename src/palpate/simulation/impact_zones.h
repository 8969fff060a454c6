#pragma once

#include <utility>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/simulation/moving_bodies.h"

namespace palpate {

/// Nodes around features that would cross each other whatever is done about one point of them: each zone moves as one,
/// with the momentum that it has, with the handle that holds some of it, or not at all where it meets what is fixed
/// (Harmon et al. 2008, "Robust treatment of simultaneous collisions", without the zones' rotation).
class ImpactZones {
 public:
  void clear();
  /// Joins the nodes of both points; zones that share a node become one.
  void join(const MovingBodies& bodies, const Contact& contact);
  /// Gives the nodes of each zone its velocity.
  void apply(const MovingBodies& bodies) const;

 private:
  using Node = std::pair<int, int>;  // body among those that move, node
  int indexOf(const Node& node);
  int rootOf(int index) const;

  std::vector<Node> nodes_;
  std::vector<int> parent_;
  std::vector<char> fixed_;
};

}  // namespace palpate
