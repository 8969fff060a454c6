#pragma once

#include <vector>

#include "palpate/contact/contact_settings.h"
#include "palpate/friction/contact_solver.h"
#include "palpate/simulation/contact_set.h"
#include "palpate/simulation/moving_bodies.h"

namespace palpate {

/// Solves the contacts of a step island by island. Owns scratch only: the result depends on the arguments alone.
class IslandSolver {
 public:
  /// Finds the islands of set.contacts (set.rows[b].contacts are each body's), forms their Delassus operators and
  /// solves them: set.impulse and set.status, from the values that they have. What is as it was in the pass before is
  /// kept.
  /// @param changed  contacts that are new, or other ones, in this pass
  /// @param scale    largest velocity of all islands: what counts as solved does not depend on how they fall apart
  ///                 [m/s]
  void findIslands(const MovingBodies& bodies, const std::vector<char>& changed, ContactSet& set);
  void solve(double h, double scale, const ContactSettings& settings, ContactSet& set);
  /// Whether a body's island was solved in an earlier pass and is as it was.
  bool keptFor(const BodyContactRows& own, const ContactSet& set) const {
    return !own.contacts.empty() && kept_[set.island[own.contacts.front()]];
  }

 private:
  struct Scratch {  // one an island, so that sizes stay
    ContactSolver solver;
    VecX free, bias, friction, impulse;
    std::vector<ContactStatus> status;
    // of what is glued: L^-1 W_EC, what its velocities are to be; W'
    MatX coupled, condensed;
    VecX target;
    Eigen::Index glued = 0;  // contacts
  };
  void joinBodies(const MovingBodies& bodies, const ContactSet& set);
  int rootOf(int body);
  bool keep(const std::vector<char>& changed, const ContactSet& set, ContactIsland& island);
  void gather(const ContactIsland& island, const ContactSet& set, double h, Scratch& own) const;
  void keepGlue(const std::vector<char>& changed, const ContactSet& set);
  static bool condense(const ContactIsland& island, MatX& glue, Scratch& own);
  static double release(const ContactIsland& island, const MatX& glue, const VecX& free, Scratch& own);
  static void solveContacts(const Eigen::Ref<const MatX>& delassus, double scale, const ContactSettings& settings,
                            ContactIsland& island, Scratch& own);
  static void solveGlued(double scale, const ContactSettings& settings, ContactIsland& island, MatX& glue,
                         Scratch& own);
  void solveIsland(std::size_t index, double h, double scale, const ContactSettings& settings, ContactSet& set);

  std::vector<ContactIsland> before_;         // of the pass before
  std::vector<char> kept_;                    // of the present pass
  std::vector<MatX> glue_, glue_before_;      // of each island a factor of W_EE, or empty; of the pass before
  std::vector<int> root_, of_root_, island_;  // while islands are found: of bodies, islands of roots, of contacts
  std::vector<Scratch> scratch_;
};

}  // namespace palpate
