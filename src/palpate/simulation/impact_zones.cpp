#include "palpate/simulation/impact_zones.h"

#include <algorithm>

namespace palpate {

void ImpactZones::clear() {
  nodes_.clear();
  parent_.clear();
  fixed_.clear();
}

int ImpactZones::indexOf(const Node& node) {
  const auto at = std::find(nodes_.begin(), nodes_.end(), node);  // few nodes, seldom
  if (at != nodes_.end()) return static_cast<int>(at - nodes_.begin());
  nodes_.push_back(node);
  parent_.push_back(static_cast<int>(parent_.size()));
  fixed_.push_back(0);
  return static_cast<int>(nodes_.size()) - 1;
}

int ImpactZones::rootOf(int index) const {
  while (parent_[index] != index) index = parent_[index];
  return index;
}

void ImpactZones::join(const MovingBodies& bodies, const Contact& contact) {
  int root = -1;
  bool fixed = false;
  for (const ContactPoint* point : {&contact.first, &contact.second}) {
    const int b = bodies.slot(*point);
    fixed = fixed || b < 0;
    for (int k = 0; b >= 0 && k < point->count; ++k) {
      const int other = rootOf(indexOf({b, point->node[k]}));
      if (root < 0) {
        root = other;
      } else if (other != root) {
        parent_[other] = root;
        fixed_[root] = fixed_[root] | fixed_[other];
      }
    }
  }
  if (fixed && root >= 0) fixed_[root] = 1;
}

void ImpactZones::apply(const MovingBodies& bodies) const {
  for (std::size_t zone = 0; zone < nodes_.size(); ++zone) {
    if (parent_[zone] != static_cast<int>(zone)) continue;
    Vec3 momentum = Vec3::Zero(), held = Vec3::Zero();
    double mass = 0;
    int attached = 0;
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      if (rootOf(static_cast<int>(i)) != static_cast<int>(zone)) continue;
      const auto [b, node] = nodes_[i];
      const Vec3 v = bodies[b].nodeEndVelocity(node);
      const double m = bodies[b].model().elasticity().mass()[node];
      momentum += m * v;
      mass += m;
      if (bodies[b].model().row()[node] >= 0) continue;
      if (bodies[b].model().isFixed(node)) {
        held = v;
        attached = 1;
        break;
      }
      held += v;
      ++attached;
    }
    Vec3 velocity = attached > 0 ? Vec3(held / attached) : Vec3(momentum / std::max(mass, 1e-300));
    if (fixed_[zone] != 0) velocity.setZero();
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      if (rootOf(static_cast<int>(i)) != static_cast<int>(zone)) continue;
      const auto [b, node] = nodes_[i];
      if (bodies[b].model().row()[node] >= 0) {
        bodies[b].setNodeEndVelocity(node, velocity);
      } else if (fixed_[zone] != 0 && !bodies[b].model().isFixed(node)) {
        bodies[b].stopHandle();
      }
    }
  }
}

}  // namespace palpate
