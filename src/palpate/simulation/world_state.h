#pragma once

#include <string>
#include <vector>

#include "palpate/contact/surface_contacts.h"
#include "palpate/simulation/body_state.h"
#include "palpate/simulation/contact_memory.h"
#include "palpate/simulation/device_target.h"

namespace palpate {

/// All of a world that one step hands to the next: exactly what must be saved to go on with the same bits, in a world
/// built from the same scene, with any number of threads. Plain data: it can be copied at any time between two steps.
struct WorldState {
  std::vector<BodyState> bodies;  ///< in the world's order
  ContactMemory contacts;
  SurfaceContactsState surfaces;
  double friction_scale = 1.0;  ///< factor on all coefficients of friction
  DeviceTarget device;          ///< target of the last step
  bool aimed = false;           ///< there was one
  double time = 0;              ///< that all steps took together [s]
  int halvings = 0;             ///< of its parts at its end, where it was done again
  double bending = 0;           ///< by which it changed velocities in its time (MotionBend) [m/s^2]
  double part_cost = 0;         ///< of one of its parts that were good, in operations
  int pulled_steps = 0;         ///< that follow() is to take pulled by the link, before it tries a path again
  int pulled_after = 0;         ///< how many there were after its last failure
};

/// The state as bytes: little-endian, version first, checksum last; the same bytes if and only if the states are the
/// same to the bit.
std::string toBytes(const WorldState& state);
/// @throws InputError if the bytes are no state, one of another version, or damaged
WorldState worldStateFrom(const std::string& bytes);
inline bool sameBits(const WorldState& a, const WorldState& b) { return toBytes(a) == toBytes(b); }

}  // namespace palpate
