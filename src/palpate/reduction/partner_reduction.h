#pragma once

#include <memory>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/reduction/modes.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// A weighted sum of nodes' motions of one body, world frame; three rows.
struct NodeSum {
  int row = 0;  ///< first of its rows in the result
  std::vector<std::pair<int, double>> nodes;
};

/// Of a body that the tool touches; world frame, free nodes, of a rigid body its six motions and no places.
struct PartnerBasis : ModalBasis {
  int body = -1;
  Pose pose{};               ///< of a rigid body
  Mat6 mass = Mat6::Zero();  ///< of a rigid body, there
  Eigen::Index first = 0;    ///< of its modes in the model

  /// Its part of what the model has for each mode.
  VecX own(const VecX& all) const { return all.segment(first, modes.cols()); }
};

/// A body that the tool touches, reduced: its lowest modes, with what it rests on tied (docs/live.md).
struct PartnerModes {
  VecX squared_frequency, damping;  ///< [1/s^2], [1/s]
  VecX force, speed;                ///< elastic, weight and all contact; at the model's time
  MatX shape;                       ///< of the sums' rows, world frame
  MatX bearing;                     ///< what each support's load gains by forces on the sums, world frame
  PartnerBasis basis;
};

/// Of a rigid body against what it rests on, some of its contacts in one; world frame.
struct PartnerSupport {
  std::vector<std::pair<int, double>> nodes;  ///< of the body
  Vec3 normal;                                ///< into the body
  double load = 0, friction = 0;              ///< normal force [N]
  Vec3 force;                                 ///< friction on the body [N]
  std::vector<int> contacts;                  ///< among those that hold the body
};
/// At most `most`. None of a body that is not rigid, is glued to another one, rests on nothing, or is held from more
/// sides than that.
std::vector<PartnerSupport> supportsOf(const World& world, int body, int most);

struct PartnerInput {
  const std::vector<NodeSum>& sums;
  const std::vector<std::pair<NodeSum, Vec3>>& loads;     ///< contact now, where it is [N]
  const BodyCorrection* correction = nullptr;             ///< that the next step brings
  const MatX* start = nullptr;                            ///< modes to begin with
  int modes = 0;                                          ///< at most; none of bodies that are glued
  const std::vector<PartnerSupport>* supports = nullptr;  ///< which are among the sums
};

/// Elastic forces of a body as a correction moves it, which its reduction and its next step ask for; they are kept.
void forcesOfPartner(World& world, int body, const BodyCorrection* correction);

/// A body that the tool touches, on the way to its PartnerModes. What asks nothing of where it is touched can be made
/// before that is known: hold() and touch() may run at the same time.
class PartnerReduction {
 public:
  /// What else holds it.
  /// @param supported  its supports have the friction, see PartnerSupport
  PartnerReduction(World& world, int body, bool supported);
  ~PartnerReduction();
  PartnerReduction(PartnerReduction&&) noexcept;
  PartnerReduction& operator=(PartnerReduction&&) noexcept;
  int body() const;
  /// Whether to begin with a body before it is known where it is touched: one of free nodes alone.
  static bool worthBeginning(const World& world, int body);

  /// Its modes, held.
  void hold(const MatX* start, int modes);
  /// What it gives way at the sums.
  void touch(const std::vector<NodeSum>& sums);
  /// All of it, as far as that is not made yet; at most once.
  /// @param own  gets W of the sums [m/N]
  PartnerModes finish(const PartnerInput& input, MatX& own);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// How much another body gives way at the given places over a visual step, W = h' J A^-1 J^T with the factor of its
/// last step, without what its modes give [m/N]. What stands still holds it: its loaded contacts with others than
/// the tool are tied, by their normals alone where its supports have the friction. Other bodies that touch it, or are
/// glued to it, yield with it.
/// @param out    is added to, [3 m x 3 m], world frame
/// @param begun  of this body, with the same sums if it knows them; null: nothing is made yet
PartnerModes reducePartner(World& world, int body, const PartnerInput& input, MatX& out,
                           PartnerReduction* begun = nullptr);

}  // namespace palpate
