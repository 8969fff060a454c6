#pragma once

#include <utility>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/live/live_model.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// A place where the tool touches something or soon may; world frame.
struct TouchPoint {
  Contact contact;            ///< tool first; for self-contact both points are the tool's
  bool internal = false;      ///< self-contact
  bool tied = false;          ///< glued: a node, at a place of another body
  double gap = 0;             ///< now [m]
  Vec3 place;                 ///< of the tool's point [m]
  Vec3 force = Vec3::Zero();  ///< on the tool [N]
};

/// One contact of the reduced model: touch points and their weights, which sum to 1.
using TouchCluster = std::vector<std::pair<int, double>>;

/// How far a model looks.
struct TouchReach {
  double margin;     ///< what is nearer, or will be, is in [m]
  double lookahead;  ///< for that long as it now moves [s]
  int most;          ///< up to so many, also what a hand that starts at once would bring near in that time
};

/// What a search has found. Of planes a large tool has thousands of vertices near, few of which become contacts.
struct NearContacts {
  std::vector<VertexNearPlane> planes;
  std::vector<Contact> others;
  std::vector<TouchPoint> points;
};

/// What the tool touches or may touch within reach; what it is glued to comes first.
/// @param tool  where it is now, if that is not where the world's state has it
/// @param near  scratch, which keeps its memory from call to call
/// @returns its points
const std::vector<TouchPoint>& findTouchPoints(World& world, const World::ToolMotion& tool, const TouchReach& reach,
                                               NearContacts& near);

/// At most `most` clusters of like facing and like partner, farthest points first. None is dropped; weights follow the
/// normal force where there is some, else the nearest point stands for all. Of what is tied all points count alike, in
/// at most kTiedClusters, which come first.
constexpr int kTiedClusters = 6;
std::vector<TouchCluster> clusterTouchPoints(const std::vector<TouchPoint>& points, int most);

}  // namespace palpate
