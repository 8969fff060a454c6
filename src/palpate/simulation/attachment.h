#pragma once

#include <functional>
#include <string>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Nodes of a body that the world holds: exactly where they were built, or by springs to there (docs/attachments.md).
struct Attachment {
  std::string name;
  std::vector<int> nodes;
  VecX stiffness;  ///< of each node's spring [N/m]; empty: fixed
  VecX damping;    ///< of each node's spring, against the world [N s/m]
  /// Where the attachment is at a time [s], against where it was built: by a displacement and a turn about `middle`.
  /// None: it stands still. The same for the same time, always.
  std::function<Pose(double)> motion;
  Vec3 middle = Vec3::Zero();  ///< of its nodes as built [m]
  bool fixed() const { return stiffness.size() == 0; }
};

/// What an attachment does to its body in a step.
struct AttachmentForce {
  Vec3 force = Vec3::Zero();   ///< [N], world
  Vec3 moment = Vec3::Zero();  ///< about the middle of the attachment's nodes at rest [N m], world
};

}  // namespace palpate
