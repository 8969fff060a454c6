#pragma once

#include "palpate/friction/contact_solver.h"

namespace palpate {

/// How contacts are found and solved. Members are named as the keys of scene files under `contact`.
struct ContactSettings {
  FrictionCone cone;
  /// A surface vertex deeper than this at the end of a pass becomes a contact of the next pass [m].
  double penetration_tolerance = 1e-5;
  /// What comes nearer than this (surfaces: nearer than thickness + margin) is a candidate for contact [m].
  double margin = 2e-4;
  /// Gap that surfaces of bodies keep from each other and from fixed ones (planes: none) [m].
  double thickness = 2e-4;
  /// Speed at which what starts inside another is pushed out [m/s].
  double max_recovery_speed = 0.5;
  /// Passes of finding and solving in a step.
  int max_passes = 8;
  /// Replaces the surface's contact points by a few that say the same; false only for the study of reduction.
  bool reduction = true;
  /// Least distance of two chosen contacts, as a fraction of the mesh's mean edge; no key of scene files.
  double spacing = 0.4;
  ContactSolverSettings solver = solverForSteps();

  /// Distance below which features of two surfaces are candidates [m].
  double surfaceReach() const { return thickness + margin; }

  /// A step must end: micrometers a second of error will do, and a hard problem gets about a second.
  static ContactSolverSettings solverForSteps() {
    ContactSolverSettings s;
    s.acceptable = 1e-6;
    s.max_operations = 1e10;
    return s;
  }
};

}  // namespace palpate
