#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/contact/contact_settings.h"
#include "palpate/contact/obstacle.h"
#include "palpate/contact/surface_contacts.h"
#include "palpate/simulation/contact_memory.h"
#include "palpate/simulation/contact_set.h"
#include "palpate/simulation/impact_zones.h"
#include "palpate/simulation/island_solver.h"
#include "palpate/simulation/moving_bodies.h"
#include "palpate/simulation/work_meter.h"

namespace palpate {

/// What the contacts of a step are found among and how they are solved; the bodies' positions at the start are known.
struct ContactInput {
  const std::vector<Obstacle>& obstacles;  ///< planes are used; other shapes are in `surfaces`
  SurfaceContacts& surfaces;
  const FrictionTable& friction;
  const ContactSettings& settings;
  WorkMeter& work;
  double share = 0.0;  ///< of the budget: what it may cost (WorkShare); 0: the end must be one that can be used
  const std::vector<Contact>* glued = nullptr;  ///< equalities, as they are at the start; null: none
};

/// Finds, reduces and solves the contacts of the bodies that move. Between steps it holds nothing but the last result:
/// what the next step depends on is in ContactMemory.
class ContactStage {
 public:
  /// Bodies must be factorized and solved free. Leaves their end velocities with contact.
  /// @param memory  of the step before; becomes this one's
  /// @returns false if a factorization that it needed failed; the end velocities are then not to be used
  [[nodiscard]] bool solve(const MovingBodies& bodies, const ContactInput& input, ContactMemory& memory);
  /// Holds back the nodes whose motion would carry a surface through another, no others.
  /// @returns the least share of a body's motion that is left
  double limitMotion(const MovingBodies& bodies, const ContactInput& input);
  const ContactSet& result() const { return set_; }
  /// Hands the last result over, memory and all; there is none until the next solve().
  ContactSet take() { return std::exchange(set_, {}); }

 private:
  // finding
  void predict(const MovingBodies& bodies, const ContactMemory& memory);
  void findOnPlanes(const MovingBodies& bodies, const ContactInput& input, double reach);
  void propose(const MovingBodies& bodies, const ContactInput& input, const ContactMemory& memory);
  void followLoaded(const MovingBodies& bodies, const ContactInput& input, const ContactMemory& memory);
  void findOnSurfaces(const ContactInput& input, double allowed);
  bool search(const MovingBodies& bodies, const ContactInput& input, const WorkShare& work);
  void correctForTurning(const MovingBodies& bodies, double bound, std::vector<Contact>& contacts) const;
  void dropImmovable(const MovingBodies& bodies);
  // choosing
  void choose(const MovingBodies& bodies, const ContactInput& input, const ContactMemory& memory);
  void takeGlued(const MovingBodies& bodies, const ContactInput& input);
  double calmOperations(const MovingBodies& bodies, const ContactMemory& memory) const;
  double gluedOperations(const MovingBodies& bodies) const;
  std::pair<int, int> findViolated();
  void addViolated(const MovingBodies& bodies, const ContactSettings& settings);
  static void correctRow(const MovingBodies& bodies, double bound, Contact& c);
  double largestChange() const;
  double promisingShare(int places);
  static int mostNew(const MovingBodies& bodies);
  static bool resisted(const MovingBodies& bodies);
  void capRecovery(double h, double speed);
  void judge(const ContactSettings& settings);
  // solving
  bool solvePass(const MovingBodies& bodies, const ContactInput& input, const WorkShare& work,
                 const ContactMemory& memory);
  bool prepareNodes(const MovingBodies& bodies);
  void warmStart(double h, const ContactMemory& memory);
  // after the last pass
  void remember(double h, const ContactSettings& settings, ContactMemory& memory);
  void rememberNear(const ContactSettings& settings, ContactMemory& memory);
  // limiting
  void stopAtPlanes(const MovingBodies& bodies, const ContactInput& input);
  void holdBack(const MovingBodies& bodies, const Contact& contact);
  bool holdBackCrossing(const MovingBodies& bodies, int round);

  ContactSet set_;
  IslandSolver islands_;
  ImpactZones zones_;
  ContactReduction reduction_;
  std::vector<char> soft_;  // bodies of the world that are
  std::vector<Contact> candidates_;
  std::vector<char> changed_;                        // contacts that the present pass has anew
  std::vector<int> violated_;                        // candidates that become contacts
  std::vector<std::pair<std::uint64_t, int>> keys_;  // of the contacts, sorted
  std::vector<std::pair<double, std::uint64_t>> crossing_times_;
  std::vector<std::uint64_t> tracks_, found_;
  std::vector<ContactRows> loaded_rows_;  // of each body, among the memory's loaded contacts
  std::vector<VecX> x_end_, x_before_;
  std::vector<std::pair<int, int>> touched_;  // of the candidates that the contacts were chosen from
};

}  // namespace palpate
