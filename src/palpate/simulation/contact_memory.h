#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/friction/contact_solver.h"
#include "palpate/math/types.h"

namespace palpate {

/// What a step leaves to the next one of its contacts: where the solver starts from, and where contact is looked for
/// first. Part of a world's state, as the result depends on it.
struct ContactMemory {
  /// Of a contact that carried force.
  struct Force {
    std::uint64_t track;
    Vec3 force;  ///< world frame [N]
    ContactStatus status;
  };
  std::vector<Force> forces;    ///< sorted by track
  std::vector<Contact> loaded;  ///< contacts that carried force
  VecX loaded_force;            ///< theirs, in their frames: 3 a contact [N]
  std::vector<Contact> near;    ///< between surfaces that were near each other at the end
  /// Body, node: those that took part in the candidates; sorted, each once.
  std::vector<std::pair<int, int>> touched;

  void clear() { *this = {}; }
  /// Nodes of a body among `touched`; appends.
  void touchedNodes(int body, int nodes, std::vector<int>& out) const;
  const Force* find(std::uint64_t track) const;
  /// Of the k-th loaded contact, world frame [N].
  Vec3 loadedForce(std::size_t k) const;
  /// Tracks of the forces, sorted.
  void tracks(std::vector<std::uint64_t>& out) const;
};

}  // namespace palpate
