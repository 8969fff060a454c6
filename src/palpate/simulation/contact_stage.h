#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/contact_finder.h"
#include "palpate/simulation/body.h"
#include "palpate/solver/contact_solver.h"

namespace palpate {

struct ContactSettings {
  FrictionCone cone;
  /// A surface vertex deeper than this at the end of a pass becomes a contact of the next pass [m].
  double penetration_tolerance = 1e-5;
  /// Vertices predicted to come this near without contact are proposed in the first pass [m].
  double reach = 2e-4;
  int max_passes = 8;
  /// false: every vertex within reach is a contact; for the study of reduction only.
  bool reduce = true;
  /// Least distance of two chosen contacts, as a fraction of the mesh's mean edge.
  double spacing = 0.4;
  ContactSolverSettings solver;
};

/// The contacts of one step and their solution; three rows a contact: normal, tangents.
struct ContactSet {
  std::vector<Contact> contacts;
  MatX delassus;  ///< W = J A^-1 J^T [1/kg], both triangles
  VecX free;      ///< row velocities without contact impulse [m/s]
  VecX impulse;   ///< lambda [N s]
  std::vector<ContactStatus> status;
  std::vector<Body::ContactRows> rows;  ///< one a body of the island

  int candidates = 0;  ///< surface vertices within reach, before reduction
  int passes = 0;
  double penetration = 0;  ///< deepest surface vertex at the end of the step [m], >= 0
  ContactSolverReport solver;
  int active() const;
  int count(ContactState state) const;
};

/// Finds, reduces and solves the contacts of bodies that are coupled by them (an island). Bodies touch fixed obstacles
/// only, so every body is an island of its own.
class ContactStage {
 public:
  /// Bodies must be factorized and solved free. Leaves their end velocities with contact.
  /// @param indices  of the bodies in the world, as contact points name them
  /// @returns false if a factorization that it needed failed; the end velocities are then not to be used
  [[nodiscard]] bool solve(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                           const std::vector<Obstacle>& obstacles, const ContactSettings& settings);
  const ContactSet& result() const { return set_; }
  /// Forgets impulses of the step before (after a jump of the state).
  void forget() {
    memory_.clear();
    kept_keys_.clear();
    earlier_.clear();
  }

 private:
  struct Memory {
    std::int64_t key;
    Vec3 force;  // world frame [N]
    ContactStatus status;
  };
  void find(const std::vector<Body*>& bodies, const std::vector<int>& indices, const std::vector<Obstacle>& obstacles,
            double reach, bool linearize_at_end);
  bool prepareNodes(const std::vector<Body*>& bodies, const std::vector<int>& indices);
  void solveOnce(const std::vector<Body*>& bodies, const std::vector<int>& indices, const ContactSettings& settings);
  void predict(const std::vector<Body*>& bodies, const std::vector<int>& indices);
  void followEarlier(const std::vector<Body*>& bodies, const std::vector<int>& indices,
                     const std::vector<Obstacle>& obstacles);
  bool addViolated(const ContactSettings& settings);
  void remember(double h);

  ContactSet set_;
  ContactSolver solver_;
  std::vector<Contact> candidates_;
  std::vector<Memory> memory_;  // sorted by key
  std::vector<std::int64_t> kept_keys_;
  std::vector<Contact> earlier_;          // those that carried force in the step before
  VecX earlier_force_, earlier_impulse_;  // theirs, in their frames [N], [N s]
  std::vector<VecX> x_end_;
  VecX bias_, friction_;
};

}  // namespace palpate
