#pragma once

#include <vector>

#include "palpate/fem/elastic_mesh.h"
#include "palpate/math/types.h"
#include "palpate/rigid/handle.h"

namespace palpate {

/// Which nodes the factor of a body's system has last, so that contact on them is cheap. It decides how the solution is
/// rounded, so it belongs to the state.
struct FactorOrder {
  bool chosen = false;          ///< false: the next step chooses
  std::vector<int> last_nodes;  ///< those that contact may touch
  int sought = 0;               ///< for so many of them, the first, the order was sought; the others were moved
  int surplus_steps = 0;        ///< steps in a row in which far too many nodes were last
};

/// All of a body that one step hands to the next.
struct BodyState {
  VecX positions, velocities;  ///< all nodes, flat: x y z of each [m], [m/s]
  HandleState handle;          ///< of a framed body
  ElasticState elastic;
  FactorOrder order;

  bool isFinite() const { return positions.allFinite() && velocities.allFinite() && handle.twist.allFinite(); }
  void clearVelocities() {
    velocities.setZero();
    handle.twist.setZero();
  }
};

}  // namespace palpate
