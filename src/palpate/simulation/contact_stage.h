#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/contact/contact_finder.h"
#include "palpate/contact/contact_settings.h"
#include "palpate/contact/surface_contacts.h"
#include "palpate/friction/contact_solver.h"
#include "palpate/simulation/body.h"

namespace palpate {

/// Contacts that act on one another: those of bodies that move and are connected through contacts. Obstacles, and
/// bodies that stand still, connect nothing.
struct ContactIsland {
  std::vector<int> contacts;  ///< of the set, increasing; rows are theirs
  std::vector<int> bodies;    ///< in ContactSet::bodies, increasing
  MatX delassus;              ///< W = J A^-1 J^T [1/kg], both triangles
  ContactSolverReport solver;
};

/// The contacts of one step and their solution; three rows a contact: normal, tangents.
struct ContactSet {
  std::vector<Contact> contacts;
  VecX free;     ///< row velocities without contact impulse [m/s]
  VecX impulse;  ///< lambda [N s]
  std::vector<ContactStatus> status;
  std::vector<ContactIsland> islands;   ///< in the order of their first contacts
  std::vector<int> island;              ///< of each contact
  std::vector<int> place;               ///< of each contact among those of its island
  std::vector<int> bodies;              ///< that move, as indices in the world
  std::vector<Body::ContactRows> rows;  ///< theirs

  int candidates = 0;  ///< points within reach, before reduction
  int passes = 0;
  double penetration = 0;  ///< deepest point below a plane at the end, or of an overlap at the start of the step [m]
  bool crossing = false;   ///< the end velocities would carry a surface through another: the motion must be cut short
  ContactSolverReport solver;  ///< worst of the islands
  int active() const;
  int count(ContactState state) const;
  /// W lambda + free of one island's rows, and of all [m/s].
  VecX rowVelocity(const ContactIsland& of) const;
  VecX rowVelocity() const;
};

/// What the contacts of a step are found among and how they are solved; the bodies' positions at the start are known.
struct ContactInput {
  const std::vector<Obstacle>& obstacles;  ///< planes are used; other shapes are in `surfaces`
  SurfaceContacts& surfaces;
  const FrictionTable& friction;
  const ContactSettings& settings;
};

/// Finds, reduces and solves the contacts of the bodies that move.
class ContactStage {
 public:
  /// Bodies must be factorized and solved free. Leaves their end velocities with contact.
  /// @param indices  of the bodies in the world, as contact points name them; bodies that are not among them stand
  /// still
  /// @returns false if a factorization that it needed failed; the end velocities are then not to be used
  [[nodiscard]] bool solve(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                           const ContactInput& input);
  /// Shares of the step's motion, one a body, that carry no surface through another.
  void limitMotion(const std::vector<Body*>& bodies, const std::vector<int>& indices, const ContactInput& input,
                   std::vector<double>& share);
  const ContactSet& result() const { return set_; }
  /// Nodes of a body that took part in the last step's candidates, each once; appends.
  void touchedNodes(int body, int nodes, std::vector<int>& out) const;
  /// Forgets impulses of the step before (after a jump of the state).
  void forget() {
    memory_.clear();
    kept_.clear();
    earlier_.clear();
    near_.clear();
    touched_.clear();
  }

 private:
  struct Memory {
    std::uint64_t track;
    Vec3 force;  // world frame [N]
    ContactStatus status;
  };
  using Bodies = std::vector<Body*>;
  using Lists = std::vector<std::vector<int>>;
  void findOnPlanes(const Bodies& bodies, const std::vector<int>& indices, const ContactInput& input, double reach);
  void propose(const Bodies& bodies, const std::vector<int>& indices, const ContactInput& input);
  void search(const Bodies& bodies, const std::vector<int>& indices, const ContactInput& input);
  void correctForTurning(const Bodies& bodies, double bound);
  int slot(const ContactPoint& point) const;
  void listByBody(const std::vector<Contact>& contacts, Lists& lists) const;
  bool prepareNodes(const Bodies& bodies, const std::vector<int>& indices);
  void findIslands();
  bool keepIsland(ContactIsland& island);
  void formDelassus(ContactIsland& island);
  void warmStart(double h);
  void solveIsland(std::size_t index, double h, double scale, const ContactSettings& settings);
  void solveIslands(double h, double scale, const ContactSettings& settings);
  void solveOnce(const Bodies& bodies, const std::vector<int>& indices, const ContactSettings& settings);
  void predict(const Bodies& bodies, const std::vector<int>& indices);
  void followEarlier(const Bodies& bodies, const ContactInput& input);
  void capRecovery(double h, double speed);
  void chooseContacts(const Bodies& bodies, const ContactSettings& settings);
  bool addViolated();
  void judge(const ContactSettings& settings);
  void stopAtPlanes(const Bodies& bodies, const std::vector<int>& indices, const ContactInput& input);
  void remember(double h);
  void rememberNear(const ContactInput& input);

  ContactSet set_;
  std::vector<int> slot_;                     // of a body of the world among those that move, -1
  Lists own_, earlier_own_;                   // contacts of each body that moves; of earlier_
  std::vector<char> changed_;                 // contacts that the present pass has anew
  std::vector<ContactIsland> old_;            // of the pass before
  std::vector<char> kept_islands_;            // of the present pass: as they were in the one before, and solved
  std::vector<int> root_, of_root_, island_;  // while islands are found: of bodies, islands of roots, of contacts
  std::vector<std::pair<std::uint64_t, int>> keys_;  // of the contacts, sorted
  struct IslandSolver {                              // one an island, so that sizes stay
    ContactSolver solver;
    VecX free, bias, friction, impulse;
    std::vector<ContactStatus> status;
  };
  std::vector<IslandSolver> solvers_;
  ContactReduction reduction_;
  std::vector<Contact> candidates_;
  std::vector<Memory> memory_;  // sorted by track
  std::vector<std::uint64_t> kept_, found_;
  std::vector<Contact> earlier_;              // those that carried force in the step before
  std::vector<Contact> near_;                 // between surfaces, at the end of the step before
  VecX earlier_force_, earlier_impulse_;      // theirs, in their frames [N], [N s]
  std::vector<std::pair<int, int>> touched_;  // body, node: sorted, of the candidates
  std::vector<VecX> x_end_;
};

}  // namespace palpate
