#pragma once

#include "palpate/mesh/implicit_surface.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Places on the alien [m], for handle regions. Frame: z up, soles on z = 0, origin between the feet, facing +y;
/// left is the alien's own, at -x.
struct AlienLandmarks {
  double height = 0;
  Vec3 head = Vec3::Zero();  ///< center of the head
  double head_radius = 0;    ///< smallest radius of the head
  Vec3 trunk = Vec3::Zero();
  Vec3 left_hand = Vec3::Zero();
  Vec3 right_hand = Vec3::Zero();
  double hand_radius = 0;
  Vec3 left_foot = Vec3::Zero();
  Vec3 right_foot = Vec3::Zero();
  double foot_radius = 0;  ///< about the foot's half length
};

struct AlienOptions {
  double height = 0.2;         ///< [m], sole to crown
  double resolution = 0.0235;  ///< grid size of the mesher in heights; gives 5,376 triangles
};

struct Alien {
  Surface surface;
  AlienLandmarks landmarks;
};

/// A toy alien: big head with bulging eyes, small trunk, thin arms and legs that stand clear of it, flat soles. A
/// smooth union of capsules and ellipsoids, meshed by meshImplicit. Throws InputError for a height or resolution out of
/// range.
Alien makeAlien(const AlienOptions& options = {});

/// The alien's implicit function for a height of 1.
double alienDistance(const Vec3& x);

}  // namespace palpate
