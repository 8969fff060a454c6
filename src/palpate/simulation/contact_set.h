#pragma once

#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/friction/contact_solver.h"
#include "palpate/math/types.h"
#include "palpate/simulation/row_selection.h"

namespace palpate {

/// Contacts that act on one another: those of bodies that move and are connected through contacts. Obstacles, and
/// bodies that stand still, connect nothing.
struct ContactIsland : ContactRows {
  std::vector<int> bodies;  ///< in ContactSet::bodies, increasing
  MatX delassus;            ///< W = J A^-1 J^T [1/kg], both triangles
  ContactSolverReport solver;
};

/// The contacts of one step and their solution; three rows a contact: normal, tangents.
struct ContactSet {
  std::vector<Contact> contacts;  ///< those that are glued first
  int glued = 0;                  ///< how many are: equalities, always of state `stick`
  VecX free;                      ///< row velocities without contact impulse [m/s]
  VecX impulse;                   ///< lambda [N s]
  std::vector<ContactStatus> status;
  std::vector<ContactIsland> islands;  ///< in the order of their first contacts
  std::vector<int> island;             ///< of each contact
  std::vector<int> place;              ///< of each contact among those of its island
  std::vector<int> bodies;             ///< that move, as indices in the world
  std::vector<BodyContactRows> rows;   ///< theirs

  int candidates = 0;  ///< points within reach, before reduction
  int passes = 0;
  double penetration = 0;  ///< deepest point below a plane at the end, or of an overlap at the start of the step [m]
  bool crossing = false;   ///< the end velocities would carry a surface through another: the motion must be cut short
  ContactSolverReport solver;  ///< worst of the islands
  double promising = 1;        ///< share of the step before so much would cross that passes hardly mend it
  bool given_up = false;       ///< looking for contacts would have cost more than was allowed
  bool resisted = false;       ///< a tool that is led along a path met more than it is led through; so far as it got

  /// Empty, for these bodies; keeps memory.
  void begin(const std::vector<int>& moving);
  /// Of the contacts that are not glued.
  int active() const;
  int count(ContactState state) const;
  /// W lambda + free of one island's rows, and of all [m/s].
  VecX rowVelocity(const ContactIsland& of) const;
  VecX rowVelocity() const;
};

}  // namespace palpate
