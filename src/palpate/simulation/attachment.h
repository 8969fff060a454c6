#pragma once

#include <functional>
#include <string>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Nodes of a body that the world holds: exactly where they were built, or by springs to there; or that are glued to
/// another body (docs/attachments.md).
struct Attachment {
  std::string name;
  std::vector<int> nodes;
  bool glued = false;
  VecX stiffness;  ///< of each node's spring [N/m]; empty: fixed, or glued
  VecX damping;    ///< of each node's spring, against the world [N s/m]
  /// Where the attachment is at a time [s], against where it was built: by a displacement and a turn about `middle`.
  /// None: it stands still. The same for the same time, always.
  std::function<Pose(double)> motion;
  Vec3 middle = Vec3::Zero();  ///< of its nodes as built [m]
  bool fixed() const { return stiffness.size() == 0 && !glued; }
};

/// What an attachment does to its body in a step.
struct AttachmentForce {
  Vec3 force = Vec3::Zero();  ///< [N], world
  /// About the middle of the attachment's nodes at rest, of glued ones where they are at the start of the step [N m],
  /// world.
  Vec3 moment = Vec3::Zero();
};

}  // namespace palpate
