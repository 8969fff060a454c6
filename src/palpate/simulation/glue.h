#pragma once

#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/simulation/body_model.h"
#include "palpate/simulation/body_state.h"

namespace palpate {

/// An attachment whose nodes are glued to another body (docs/attachments.md).
struct Joint {
  int body = -1;  ///< index in the world
  int attachment = -1;
  int partner = -1;                  ///< index in the world
  std::vector<ContactPoint> places;  ///< of the partner, where each of the attachment's nodes is
};

/// Finds the places: in the partner's tetrahedron that is nearest to each node as built, or in its frame.
/// @param body, partner  indices in `models`
/// @throws InputError  (attachment's name, key, cause) if a node is farther than a mean edge from the partner, or if
/// the
///                     partner is the body itself
Joint joinBodies(const std::vector<const BodyModel*>& models, int body, int attachment, int partner);

/// @throws InputError if nodes are glued to nodes that are, in one or more steps, glued to them
void refuseCircles(const std::vector<const BodyModel*>& models, const std::vector<Joint>& joints);

/// The equalities of a step, at its start: with world axes as a frame, and with the gap as it is there. Of joints whose
/// own body moves; appends.
/// @param moves  one a body
void glueContacts(const std::vector<const BodyModel*>& models, const std::vector<Joint>& joints,
                  const std::vector<BodyState>& states, const std::vector<char>& moves, std::vector<Contact>& out);

/// One a vertex of the body's surface: 1 in tetrahedra that have one of the attachment's nodes.
std::vector<char> surfaceAround(const BodyModel& body, const Attachment& attachment);

}  // namespace palpate
