#include "palpate/simulation/contact_set.h"

#include <algorithm>

namespace palpate {

void ContactSet::begin(const std::vector<int>& moving) {
  contacts.clear();
  glued = 0;
  impulse.resize(0);
  status.clear();
  island.clear();
  bodies = moving;
  rows.resize(moving.size());
  for (BodyContactRows& own : rows) {
    own.contacts.clear();
    own.known = 0;
  }
  solver = ContactSolverReport::nothing();
  promising = 1;
  given_up = resisted = false;
  passes = 0;
  candidates = 0;
  penetration = 0;
  crossing = false;
}

int ContactSet::active() const { return static_cast<int>(contacts.size()) - glued - count(ContactState::open); }

int ContactSet::count(ContactState state) const {
  const auto first = std::min<std::ptrdiff_t>(glued, static_cast<std::ptrdiff_t>(status.size()));
  return static_cast<int>(
      std::count_if(status.begin() + first, status.end(), [&](const ContactStatus& s) { return s.state == state; }));
}

VecX ContactSet::rowVelocity(const ContactIsland& of) const {
  VecX w = of.gather(free);
  w.noalias() += of.delassus * of.gather(impulse);
  return w;
}

VecX ContactSet::rowVelocity() const {
  VecX all(free.size());
  for (const ContactIsland& of : islands) of.scatter(rowVelocity(of), all);
  return all;
}

}  // namespace palpate
