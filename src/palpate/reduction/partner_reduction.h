#pragma once

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

/// How much another body gives way at the given places over a visual step, W = h' J A^-1 J^T with the factor of its
/// last step, without what its modes give [m/N]. What else it rests on holds it: its loaded contacts with others than
/// the tool are tied, by their normals alone where its supports have the friction. Bodies that are glued to it yield
/// with it.
/// @param out  is added to, [3 m x 3 m], world frame
PartnerModes reducePartner(World& world, int body, const PartnerInput& input, MatX& out);

}  // namespace palpate
